"""Write the pictures of the documentation that show no experiment: the stages of one exposure, and a turning cloud."""

from __future__ import annotations

import sys
from pathlib import Path

from tools.docs import cloud, stage_pictures, stages

IMAGES = Path("docs") / "images"


def main() -> int:
    """Write docs/images/method/*.png and docs/images/cloud.gif."""
    stage_pictures.draw_stages(stages.measure(), IMAGES / "method")
    cloud.draw_turning(cloud.measure(), IMAGES / "cloud.gif")
    print(f"written: {IMAGES / 'method'} and {IMAGES / 'cloud.gif'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
