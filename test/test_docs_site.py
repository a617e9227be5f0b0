"""The documentation as a site: it builds without a warning, is whole, and asks nobody else for anything."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest
from source_scan import ROOT

pytest.importorskip("material", reason="mkdocs-material is not installed: pip install -e .[docs]")
LOADED = re.compile(r'<(?:img|script|link|iframe|source)\b[^>]*?\b(?:src|href)="?([^"\s>]+)')


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return folder


def test_the_first_page_is_the_readme_with_its_links_in_the_site(site: Path) -> None:
    page = (site / "index.html").read_text()
    assert "An open fringe-projection 3D sensor for robots" in page
    assert 'href="method.html"' in page
    assert "docs/method.md" not in page


def test_a_link_to_a_test_leads_to_its_code(site: Path) -> None:
    page = (site / "comparison.html").read_text()
    file, test = "source/test/test_ros_messages.py.html", "test_depth_image_is_rep_118_in_both_encodings"
    assert f'href="{file}#{test}"' in page
    assert f'id="{test}"' in (site / file).read_text()


def test_what_a_page_loads_is_in_the_site(site: Path) -> None:
    pages = [path for path in site.rglob("*.html") if path.name != "404.html"]
    assert len(pages) > 15
    for page in pages:
        for target in LOADED.findall(page.read_text()):
            assert "//" not in target, f"{page.name} loads {target}"
            name = unquote(target.partition("?")[0].partition("#")[0])
            assert not name or (page.parent / name).exists(), f"{page.name} loads {target}"


def test_styles_load_nothing_from_elsewhere(site: Path) -> None:
    styles = list(site.rglob("*.css"))
    assert styles
    for style in styles:
        assert not re.search(r"(url\(|@import )['\"]?(https?:)?//", style.read_text()), style.name
