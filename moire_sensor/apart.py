"""Compiler options of kernels over rows whose arguments lie apart in memory.

Where a loop writes one array and reads another at places known only at run time, the compiler must fear that they are
the same memory, and leaves the loop scalar. Told that no argument overlaps what another writes, it makes vectors of
it, gathers included. Whoever calls such a kernel has to keep that promise.
"""

from __future__ import annotations

from typing import Any

from numba.core.compiler import CompilerBase, DefaultPassBuilder

from moire_sensor.angles import FAST, NAN_SAFE


class Apart(CompilerBase):  # type: ignore[misc]
    """Compiles a function whose written arguments overlap no other one."""

    def define_pipelines(self) -> list[Any]:
        """The usual passes, with that promise made to LLVM."""
        self.state.flags.noalias = True
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]


# Of numbers that are never NaN, and of those that may be.
ROW_FAST: dict[str, Any] = {**FAST, "pipeline_class": Apart}
ROW: dict[str, Any] = {"fastmath": NAN_SAFE, "error_model": "numpy", "pipeline_class": Apart}
# The same for kernels that only compute, called for few columns at a time.
LEAF: dict[str, Any] = {**ROW, "_nrt": False}
LEAF_FAST: dict[str, Any] = {**ROW_FAST, "_nrt": False}
