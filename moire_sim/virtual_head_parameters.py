"""Parameters of the node ``virtual_head``: the fringes, which may change at run time, and light and optics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from moire_sensor.errors import SettingsError
from moire_sensor.paper_rig import PERIOD_PX
from moire_sensor.pattern import MIN_PERIOD_PX, WAVEFORMS, FringePattern
from moire_sensor.ros.parameters import ParameterSpec
from moire_sensor.ros.projector_state import MAX_STEP_COUNT
from moire_sim.fringe_image import Light
from moire_sim.head_options import MOST_PROCESSES, PRESETS, HeadOptions, preset
from moire_sim.optics import Optics
from moire_sim.renderer_choice import RENDERERS

MAX_PERIOD_PX = 10000.0
# These follow ros2 param set from the next exposure on.
FRINGE_SPECS = (
    ParameterSpec("phase_steps", 1, "exposures of one programme; 1: single shot", 1, MAX_STEP_COUNT),
    ParameterSpec("period_px", PERIOD_PX, "projector columns per fringe", MIN_PERIOD_PX, MAX_PERIOD_PX),
    ParameterSpec("second_period_px", 0.0, "columns per fringe of every other result; 0: none", 0.0, MAX_PERIOD_PX),
    ParameterSpec("phase_rad", 0.0, "fringe phase at projector column 0, rad", -1e3, 1e3),
    ParameterSpec("waveform", WAVEFORMS[0], "shape of the fringes", choices=WAVEFORMS),
)
PRESET_SPEC = ParameterSpec(
    "optics", "clean", "values of the optics' parameters that are not given", choices=tuple(PRESETS), read_only=True
)
RENDERER_SPEC = ParameterSpec(
    "renderer", "tiny", "of the geometry; auto: egl, the quicker, where it works", choices=RENDERERS, read_only=True
)
PROCESSES_SPEC = ParameterSpec(
    "render_processes", 0, "processes that render what moves; 0: 3, or 1 on one core", 0, MOST_PROCESSES, read_only=True
)


def optics_specs(name: str = "clean") -> tuple[ParameterSpec, ...]:
    """Return the parameters of light, noise and optics; their defaults are a preset's."""
    options = preset(name)
    noise = ParameterSpec("noise", options.noise, "camera noise, 8-bit grey levels", 0.0, 50.0, read_only=True)
    bits = ParameterSpec("bits", options.bits, "of the images: 8 (mono8), 12 or 16 (mono16)", 8, 16, read_only=True)
    return noise, bits, *field_specs(options.light), *field_specs(options.optics)


def field_specs(values: Light | Optics) -> tuple[ParameterSpec, ...]:
    """Return a parameter for each field, whose metadata hold range and text."""
    return tuple(
        ParameterSpec(
            item.name, getattr(values, item.name), item.metadata["text"], item.metadata["low"], item.metadata["high"],
            read_only=True,
        )
        for item in fields(values)
    )  # fmt: skip


def options_of(values: Mapping[str, Any]) -> HeadOptions:
    """Return the options that parameters ask for; raises SettingsError for values that do not go together."""
    if values["bits"] not in (8, 12, 16):
        raise SettingsError(f"parameter bits is {values['bits']}; allowed are 8, 12 and 16")
    light, optics = ({item.name: values[item.name] for item in fields(kind)} for kind in (Light, Optics))
    rendering = {name: values[name] for name in ("renderer", "render_processes")}
    return HeadOptions(Light(**light), values["noise"], values["bits"], optics=Optics(**optics), **rendering)

def patterns_of(values: Mapping[str, Any]) -> tuple[FringePattern, ...]:
    """Return the patterns that parameters ask for, one or two; raises PatternError where they cannot be shown."""
    periods = [values["period_px"], *([values["second_period_px"]] if values["second_period_px"] else [])]
    return tuple(
        FringePattern(period, values["phase_rad"], waveform=values["waveform"]).with_equal_steps(values["phase_steps"])
        for period in periods
    )
