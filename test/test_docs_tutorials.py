"""The program of docs/simulated_head.md, run as it stands there, does what the page promises."""

from __future__ import annotations

import re
from typing import Any

import pytest
from source_scan import ROOT

PAGE = (ROOT / "docs" / "simulated_head.md").read_text(encoding="utf-8")


def test_the_comparison_with_the_truth_is_as_good_as_the_page_says(capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    program: dict[str, Any] = {}
    exec(code, program)
    complete, error_mm = map(float, re.findall(r"(\d+\.\d+) (?:%|mm)", capsys.readouterr().out))
    promised, promised_mm = map(float, re.findall(r"prints (\d+\.\d+) % and (\d+\.\d+) mm", PAGE)[0])
    # Half of the last digit that the page gives.
    assert complete >= promised - 0.05
    assert error_mm <= promised_mm + 0.005
