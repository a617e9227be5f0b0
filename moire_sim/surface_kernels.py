"""The parts of light and shadow that visit each pixel, compiled; operation for operation as numpy would do them.

Division by zero gives infinity or NaN, as in numpy, and comparisons with those are false.
"""

from __future__ import annotations

from numba import njit


@njit(cache=True, error_model="numpy", nogil=True)
def fill_visible(own, inverse_z, faces, intrinsic, depth_m, bias_m, reach, seen):  # type: ignore[no-untyped-def]
    """Fill ``seen`` (N,) for :func:`moire_sim.device_view.visible_share`; ``own`` (N, 3) in the device's frame."""
    height, width = depth_m.shape
    fx, skew, cx = intrinsic[0, 0], intrinsic[0, 1], intrinsic[0, 2]
    fy, cy = intrinsic[1, 1], intrinsic[1, 2]
    for i in range(own.shape[0]):
        seen[i] = 0.0
        x, y, z = own[i, 0], own[i, 1], own[i, 2]
        column, row = (fx * x + skew * y) / z + cx, fy * y / z + cy
        inside = column > -0.5 and column < width - 0.5 and row > -0.5 and row < height - 0.5 and z > 0.0
        if not (inside and faces[i]):
            continue
        nearest_m, furthest_m = (1.0 - reach) * z, (1.0 + reach) * z
        left, top = int(column + 1.0) - 1, int(row + 1.0) - 1
        across_part, down_part = column - left, row - top
        share = 0.0
        for across in range(2):
            at_column = min(max(left + across, 0), width - 1)
            column_weight = across_part if across else 1.0 - across_part
            for down in range(2):
                at_row = min(max(top + down, 0), height - 1)
                row_weight = down_part if down else 1.0 - down_part
                expected = 1.0 / (inverse_z[i, 0] * at_column + inverse_z[i, 1] * at_row + inverse_z[i, 2])
                expected = min(max(expected, nearest_m), furthest_m)
                found = depth_m[at_row, at_column]
                # Where the device sees nothing, nothing hides the point.
                if not found <= expected - bias_m:
                    share += column_weight * row_weight
        seen[i] = share


@njit(cache=True, error_model="numpy", nogil=True)
def fill_smooth_difference(values, difference):  # type: ignore[no-untyped-def]
    """Fill ``difference`` (H, W) along the rows, for :func:`moire_sim.device_view.smooth_difference`."""
    height, width = values.shape
    padded = [0.0] * (width + 4)
    for row in range(height):
        for column in range(width):
            padded[column + 2] = values[row, column]
        for k in (1, 2):
            padded[2 - k] = 2.0 * values[row, 0] - values[row, k]
            padded[width + 1 + k] = 2.0 * values[row, width - 1] - values[row, width - 1 - k]
        for column in range(width):
            before = padded[column + 2] - padded[column + 1]
            after = padded[column + 3] - padded[column + 2]
            bend_before = abs(before - (padded[column + 1] - padded[column]))
            bend_here = abs(after - before)
            bend_after = abs((padded[column + 4] - padded[column + 3]) - after)
            least = min(bend_before, bend_after)
            if bend_here <= 4.0 * least + 1e-6 * padded[column + 2]:
                difference[row, column] = (before + after) / 2.0
            else:
                difference[row, column] = before if bend_before < bend_after else after
