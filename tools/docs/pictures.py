"""Write the documentation's pictures that show no experiment: stages of one exposure, a turning cloud, all scenes."""

from __future__ import annotations

import sys
from pathlib import Path

from tools.docs import cloud, gallery, stage_pictures, stages

IMAGES = Path("docs") / "images"


def main() -> int:
    """Write docs/images/method/*.png, docs/images/cloud.gif and docs/images/scenes.png."""
    stage_pictures.draw_stages(stages.measure(), IMAGES / "method")
    cloud.draw_turning(cloud.measure(), IMAGES / "cloud.gif")
    gallery.draw_scenes(IMAGES / "scenes.png")
    print(f"written: {IMAGES / 'method'}, {IMAGES / 'cloud.gif'} and {IMAGES / 'scenes.png'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
