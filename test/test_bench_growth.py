"""The benchmark of stages, growth and memory measures what it says."""

from __future__ import annotations

from moire_sensor import phase_pipeline
from moire_sensor.order_solver import OrderSolver
from tools.bench.growth import GROWING, memory_records
from tools.bench.speed import LARGEST_SIZE, SIZES, THREADS, USUAL_SIZE, scaled_rig
from tools.bench.stages import REST, Clock, stage_records, stages, timed_stages


def test_the_stages_are_those_of_the_pipeline_which_is_left_as_it_was() -> None:
    before = phase_pipeline.extend, OrderSolver.solve
    records = stage_records(rounds=3)
    assert (phase_pipeline.extend, OrderSolver.solve) == before
    names = [one.name for one in records]
    assert names.index("phase_single.phase_from_single") < names.index("order_solver.solve") < names.index(
        "depth_border.extend"
    )
    assert names[-1] == REST
    assert all(len(one.milliseconds) == len(THREADS) for one in records)
    assert all(ms > 0.0 for one in records[:-1] for ms in one.milliseconds)


def test_what_a_stage_calls_counts_as_its_own_and_an_error_passes() -> None:
    clock = Clock()
    inner = clock.around("inner", lambda: 1)
    outer = clock.around("outer", lambda: inner() + 1)
    assert outer() == 2
    assert set(clock.seconds) == {"outer"}
    before = {label: stage for label, (_, _, stage) in stages().items()}
    try:
        with timed_stages(Clock()):
            raise KeyError
    except KeyError:
        pass
    assert {label: stage for label, (_, _, stage) in stages().items()} == before


def test_all_sizes_see_what_the_paper_rig_sees() -> None:
    usual = scaled_rig(USUAL_SIZE)
    for size in SIZES:
        rig = scaled_rig(size)
        assert rig.image_size == size
        share = rig.disparity_px(1.0) / size[0]
        assert abs(share - usual.disparity_px(1.0) / USUAL_SIZE[0]) < 1e-9


def test_memory_holds_a_shot_at_least() -> None:
    """In a process of its own: the seven images of a shot are in what it needs beside the imports."""
    found = next(memory_records([(GROWING[-1], LARGEST_SIZE)]))
    width, height = LARGEST_SIZE
    # Five of float32, one of int16, one of uint8.
    shot_mb = width * height * (5 * 4 + 2 + 1) / 2**20
    assert found.imports_mb > 0.0
    assert found.peak_mb - found.imports_mb > shot_mb
