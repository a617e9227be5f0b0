"""Compiled kernels kept on disk, forgotten when anything that they were compiled from has changed.

numba keeps a kernel for as long as the text of its own file is the same. A helper that it inlines from another file may
change unseen, by an upgrade for example, and the old kernel would still run.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
import warnings
from pathlib import Path

STAMP = "sources.json"


def forget_outdated(kernel: object, package: Path) -> set[str]:
    """Delete the kept kernels of a package's modules whose sources, or those that they import from it, have changed.

    Parameters
    ----------
    kernel : a compiled function of the package that is kept on disk; it tells where they are kept. One that is not
        compiled, or kept nowhere, has nothing to forget. Kernels that have run in this process stay as they are.
    package : folder of the modules.

    Returns
    -------
    Names of the modules whose kernels were forgotten. A folder that cannot be written is a warning.
    """
    kept = getattr(getattr(kernel, "stats", None), "cache_path", None)
    if kept is None:
        return set()
    stamp = Path(kept) / STAMP
    digests = module_digests(package)
    before = stamped(stamp)
    outdated = {name for name, digest in digests.items() if before.get(name) != digest}
    if outdated:
        try:
            renew(stamp, outdated, digests)
        except OSError as error:
            warnings.warn(f"old compiled kernels may run: {error}; delete {kept}/*.nb?", RuntimeWarning, stacklevel=2)
    return outdated


def module_digests(package: Path) -> dict[str, str]:
    """Digest of every module of a package with all that it imports from it, by name."""
    texts = {path.stem: path.read_bytes() for path in package.glob("*.py")}
    line = re.compile(rf"^from {package.name}\.(\w+) import".encode(), re.MULTILINE)
    imports = {name: {part.decode() for part in line.findall(text)} for name, text in texts.items()}
    single = {name: hashlib.sha256(text).digest() for name, text in texts.items()}
    return {
        name: hashlib.sha256(b"".join(single[part] for part in sorted(closure(name, imports)))).hexdigest()
        for name in texts
    }


def closure(name: str, imports: dict[str, set[str]]) -> set[str]:
    """Return a module and all that it imports, directly or not, as far as they are known."""
    found, left = {name}, [name]
    while left:
        more = (imports[left.pop()] & imports.keys()) - found
        found |= more
        left += more
    return found


def stamped(stamp: Path) -> dict[str, str]:
    """Digests of the kernels that are kept; none where they are not known."""
    with contextlib.suppress(OSError, ValueError):
        found = json.loads(stamp.read_text())
        if isinstance(found, dict):
            return found
    return {}


def renew(stamp: Path, outdated: set[str], digests: dict[str, str]) -> None:
    """Delete outdated kernels and write the new digests; another process may be doing the same."""
    stamp.parent.mkdir(parents=True, exist_ok=True)
    for path in stamp.parent.glob("*.nb[ic]"):
        if path.name.split(".")[0] in outdated:
            path.unlink(missing_ok=True)
    part = stamp.with_suffix(".part")
    part.write_text(json.dumps(digests))
    part.replace(stamp)
