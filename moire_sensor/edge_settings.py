"""Configuration of the paper's fringe-edge method: the names of section 3.4, each with unit and range."""

from __future__ import annotations

from dataclasses import dataclass

from moire_sensor.errors import SettingsError
from moire_sensor.settings import check_ranges, setting


@dataclass(frozen=True)
class EdgeSettings:
    """Tuning of ``fringe_edges``. Grey levels are scaled to 255 at saturation; costs have no unit.

    The paper names the costs and orders them, ``lambda_oc < lambda_mat < penalty``, without giving numbers. Its
    penalty, "very big", is infinite here: edges of different sides never match. Beyond the paper, each to be switched
    off: ``lambda_off`` tells a wrong fringe order whose candidates happen to lie within the tolerance all over a
    slanted board, and which J would prefer where it is the farther one, since the views share more of what is far;
    ``same_height`` (switched off by 100), ``doubtful_share`` (by 2) and ``min_run`` (by 1).

    Raises
    ------
    SettingsError
        A value outside its range, or costs in another order than the paper's.
    """

    lambda_oc: float = setting(1.5, 0.0, 1e3, "occlusion penalty, once per run of unmatched edges")
    lambda_r: float = setting(1.0, 0.0, 1e3, "reward of a match")
    lambda_mat: float = setting(2.0, 0.0, 1e3, "dissimilarity of two edges of which only the side agrees")
    lambda_off: float = setting(
        0.4, 0.0, 1e3, "dissimilarity of correspondences 0.2 times the largest distance apart, or more; 0: the paper's"
    )
    same_side_periods: float = setting(
        0.072, 0.001, 0.25, "largest distance of a left edge from a candidate, periods (1.2 px in the paper's rig)"
    )
    same_height: float = setting(1.5, 1.0, 100.0, "largest ratio of the heights of two edges that correspond")
    doubtful_share: float = setting(
        0.6, 0.5, 2.0, "least share of a run's edges that another order matches as closely, for both to be refused"
    )
    min_amplitude: float = setting(6.0, 0.5, 127.0, "smallest half height of a fringe edge, grey levels of 255")
    min_amplitude_to_noise: float = setting(3.0, 0.0, 100.0, "smallest ratio of half height to camera noise")
    min_run: int = setting(2, 1, 100, "edges side by side that must agree on the fringe order; 1 is the paper's")  # type: ignore[assignment]
    rows: int = setting(1, 1, 1000, "every rows-th row is solved, the others follow their neighbours")  # type: ignore[assignment]
    follow_px: float = setting(1.5, 0.1, 8.0, "largest shift of an edge from one row to the next, pixels")

    def __post_init__(self) -> None:
        check_ranges(self)
        if not self.lambda_oc < self.lambda_mat:
            raise SettingsError(
                f"lambda_oc {self.lambda_oc} and lambda_mat {self.lambda_mat} are out of order; "
                "choose lambda_oc < lambda_mat (section 3.4)"
            )
        for name in ("min_run", "rows"):
            if getattr(self, name) != int(getattr(self, name)):
                raise SettingsError(f"{name} is {getattr(self, name)}; give a whole number")
