"""How kernels are compiled: every set of options once, and why.

Kernels over rows may promise that their arguments lie apart in memory. Where a loop writes one array and reads another
at places known only at run time, the compiler must fear that they are the same memory, and leaves the loop scalar. Told
that no argument overlaps what another writes, it makes vectors of it, gathers included. Whoever calls such a kernel has
to keep that promise; test_apart.py checks every call of a reconstruction.
"""

from __future__ import annotations

from typing import Any

from numba.core.compiler import CompilerBase, DefaultPassBuilder


class Apart(CompilerBase):  # type: ignore[misc]
    """Compiles a function whose written arguments overlap no other one."""

    def define_pipelines(self) -> list[Any]:
        """The usual passes, with that promise made to LLVM."""
        self.state.flags.noalias = True
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]


# Of numbers that are never NaN: every liberty with float32, no checks of divisors.
FAST: dict[str, Any] = {"fastmath": True, "error_model": "numpy"}
# Liberties the compiler may take where NaN has a meaning: all of fastmath but the promise that there is none.
NAN_SAFE = {"arcp", "contract", "nsz", "reassoc"}
# Kernels over rows that lie apart, of numbers that are never NaN and of those that may be.
ROW_FAST: dict[str, Any] = {**FAST, "pipeline_class": Apart}
ROW: dict[str, Any] = {"fastmath": NAN_SAFE, "error_model": "numpy", "pipeline_class": Apart}
# Kernels over rows that lie apart, rounded as written.
EXACT: dict[str, Any] = {"error_model": "numpy", "pipeline_class": Apart}
# No count of references to arrays, two locked steps for each: for kernels that only compute, called for few columns at
# a time. They can neither make nor return an array, nor assign a slice to a slice.
UNCOUNTED: dict[str, Any] = {"_nrt": False, "error_model": "numpy"}
LEAF_FAST: dict[str, Any] = {**ROW_FAST, **UNCOUNTED}
LEAF: dict[str, Any] = {**ROW, **UNCOUNTED}
# Helpers for single pixels. Sums keep their order: rows of ten pixels are slower in vectors.
BARE: dict[str, Any] = {**UNCOUNTED, "fastmath": {"arcp", "contract", "nsz"}}
