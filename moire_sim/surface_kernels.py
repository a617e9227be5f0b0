"""Points, tangent planes, light and shadow of each pixel, compiled.

Every sum is written out, so its order, and with it the last bit, depends on no library. Division by zero gives infinity
or NaN, as in numpy, and comparisons with those are false. A device is ``intrinsic`` (3, 3), ``rotation`` (3, 3) and
``shift`` (3,) from the left optical frame.
"""

from __future__ import annotations

import numpy as np
from numba import njit

# 1 / z where nothing is seen, 1 / m: far behind everything.
NOTHING = 1e-3
# The simulator's segmentation holds the body in its lower bits, the link above.
BODY_BITS = (1 << 24) - 1


@njit(cache=True, error_model="numpy", nogil=True)
def fill_depth(window, near_m, far_m, depth_m):  # type: ignore[no-untyped-def]
    """Fill ``depth_m`` (N,) from an OpenGL depth buffer, 0 near to 1 far; NaN at 1, where nothing is seen."""
    for i in range(window.size):
        share = np.float64(window[i])
        z = far_m * near_m / (far_m - (far_m - near_m) * share)
        depth_m[i] = z if share < 1.0 - 1e-6 else np.nan


@njit(cache=True, error_model="numpy", nogil=True)
def fill_bodies(segments, number_of, depth_m, bodies):  # type: ignore[no-untyped-def]
    """Fill ``bodies`` (N,) with the scene's numbers of the simulator's ``segments`` (N,); -1 where nothing is seen."""
    for i in range(segments.size):
        bodies[i] = number_of[segments[i] & BODY_BITS] if depth_m[i] == depth_m[i] else -1


@njit(cache=True, error_model="numpy", nogil=True)
def fill_padded(depth_m, padded):  # type: ignore[no-untyped-def]
    """Fill ``padded`` (H + 4, W + 4) with 1 / z of ``depth_m`` (H, W), carried on in straight lines by two pixels."""
    height, width = depth_m.shape
    for row in range(height):
        line = padded[row + 2]
        for column in range(width):
            z = depth_m[row, column]
            line[column + 2] = 1.0 / z if z == z else NOTHING
        for k in (1, 2):
            line[2 - k] = 2.0 * line[2] - line[2 + k]
            line[width + 1 + k] = 2.0 * line[width + 1] - line[width + 1 - k]
    for k in (1, 2):
        for column in range(width + 4):
            padded[2 - k, column] = 2.0 * padded[2, column] - padded[2 + k, column]
            padded[height + 1 + k, column] = 2.0 * padded[height + 1, column] - padded[height + 1 - k, column]


@njit(cache=True, error_model="numpy", nogil=True)
def smooth_difference(far_before, before, here, after, far_after):  # type: ignore[no-untyped-def]
    """Difference per pixel in the middle of five: central on smooth parts, beside an edge the smoother side's (ENO)."""
    rise_before, rise_after = here - before, after - here
    bend_before = abs(rise_before - (before - far_before))
    bend_after = abs((far_after - after) - rise_after)
    if abs(rise_after - rise_before) <= 4.0 * min(bend_before, bend_after) + 1e-6 * here:
        return (rise_before + rise_after) / 2.0
    return rise_before if bend_before < bend_after else rise_after


@njit(cache=True, error_model="numpy", nogil=True)
def fill_planes(padded, intrinsic, rotation, shift, planes):  # type: ignore[no-untyped-def]
    """Fill ``planes`` (H, W, 3), ``q . X = 1`` in the left optical frame, from 1 / z as :func:`fill_padded` has it."""
    height, width = planes.shape[:2]
    fx, skew, cx = intrinsic[0, 0], intrinsic[0, 1], intrinsic[0, 2]
    fy, cy = intrinsic[1, 1], intrinsic[1, 2]
    for row in range(height):
        above, over, line = padded[row], padded[row + 1], padded[row + 2]
        under, below = padded[row + 3], padded[row + 4]
        for i in range(width):
            c = i + 2
            across = smooth_difference(line[i], line[i + 1], line[c], line[i + 3], line[i + 4])
            down = smooth_difference(above[c], over[c], line[c], under[c], below[c])
            x, y = across * fx, across * skew + down * fy
            z = across * cx + down * cy + (line[c] - across * i - down * row)
            # q . (R X + t) = 1 is (R^T q) . X = 1 - q . t.
            scale = 1.0 - (x * shift[0] + y * shift[1] + z * shift[2])
            for k in range(3):
                planes[row, i, k] = (x * rotation[0, k] + y * rotation[1, k] + z * rotation[2, k]) / scale


@njit(cache=True, error_model="numpy", nogil=True)
def fill_points(depth_m, inverse_intrinsic, rotation, shift, points):  # type: ignore[no-untyped-def]
    """Fill ``points`` (H, W, 3), left optical frame, from z (H, W) along a device's axis."""
    height, width = depth_m.shape
    a, b, c = inverse_intrinsic[0, 0], inverse_intrinsic[0, 1], inverse_intrinsic[0, 2]
    d, e = inverse_intrinsic[1, 1], inverse_intrinsic[1, 2]
    for row in range(height):
        for column in range(width):
            z = depth_m[row, column]
            x = (a * column + b * row + c) * z - shift[0]
            y = (d * row + e) * z - shift[1]
            z = z - shift[2]
            for k in range(3):
                points[row, column, k] = x * rotation[0, k] + y * rotation[1, k] + z * rotation[2, k]


@njit(cache=True, error_model="numpy", nogil=True)
def fill_pixels(points, projection, pixels):  # type: ignore[no-untyped-def]
    """Fill ``pixels`` (N, 2), column and row, of points (N, 3) by a projection (3, 4); 0 for none and behind it."""
    for i in range(points.shape[0]):
        x, y, z = moved(points[i], projection[:, :3], projection[:, 3])
        if z > 0.0:
            pixels[i, 0], pixels[i, 1] = x / z, y / z
        else:
            pixels[i, 0] = pixels[i, 1] = 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def fill_lambert(points, planes, light_m, lambert):  # type: ignore[no-untyped-def]
    """Fill ``lambert`` (N,): cosine between normal and way to the light, 0 where it faces away or nothing is seen."""
    for i in range(lambert.size):
        qx, qy, qz = planes[i, 0], planes[i, 1], planes[i, 2]
        x, y, z = points[i, 0] - light_m[0], points[i, 1] - light_m[1], points[i, 2] - light_m[2]
        scale = ((qx * qx + qy * qy + qz * qz) * (x * x + y * y + z * z)) ** 0.5
        cosine = (qx * x + qy * y + qz * z) / scale
        lambert[i] = min(cosine, 1.0) if cosine > 0.0 else 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def fill_visible(points, planes, device, depth_m, bias_m, reach, seen):  # type: ignore[no-untyped-def]
    """Fill ``seen`` (N,) for :func:`moire_sim.device_view.visible_share`; ``device``: intrinsic, rotation, shift."""
    intrinsic, rotation, shift = device
    height, width = depth_m.shape
    fx, skew, cx = intrinsic[0, 0], intrinsic[0, 1], intrinsic[0, 2]
    fy, cy = intrinsic[1, 1], intrinsic[1, 2]
    for i in range(seen.size):
        seen[i] = 0.0
        x, y, z = moved(points[i], rotation, shift)
        column, row = (fx * x + skew * y) / z + cx, fy * y / z + cy
        if not (z > 0.0 and column > -0.5 and column < width - 0.5 and row > -0.5 and row < height - 0.5):
            continue
        # The plane in the device's frame: q' . X' = 1 + q' . t; a plane seen from behind shows nothing.
        qx, qy, qz = turned(planes[i], rotation)
        scale = 1.0 + (qx * shift[0] + qy * shift[1] + qz * shift[2])
        if not (qx * x + qy * y + qz * z > 0.0):
            continue
        by_column = qx / fx
        by_row = (qy - by_column * skew) / fy
        constant = qz - by_column * cx - by_row * cy
        left, top = int(column + 1.0) - 1, int(row + 1.0) - 1
        across_part, down_part = column - left, row - top
        for across in range(2):
            at_column = min(max(left + across, 0), width - 1)
            column_weight = across_part if across else 1.0 - across_part
            for down in range(2):
                at_row = min(max(top + down, 0), height - 1)
                row_weight = down_part if down else 1.0 - down_part
                expected = scale / (by_column * at_column + by_row * at_row + constant)
                expected = min(max(expected, (1.0 - reach) * z), (1.0 + reach) * z)
                # Where the device sees nothing, nothing hides the point.
                if not depth_m[at_row, at_column] <= expected - bias_m:
                    seen[i] += column_weight * row_weight


@njit(cache=True, error_model="numpy", nogil=True)
def turned(vector, rotation):  # type: ignore[no-untyped-def]
    """Return a vector (3,) turned by a rotation (3, 3)."""
    x, y, z = vector[0], vector[1], vector[2]
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


@njit(cache=True, error_model="numpy", nogil=True)
def moved(point, rotation, shift):  # type: ignore[no-untyped-def]
    """Return a point (3,) in a device's frame."""
    x, y, z = turned(point, rotation)
    return x + shift[0], y + shift[1], z + shift[2]
