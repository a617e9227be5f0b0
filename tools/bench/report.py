"""docs/bench.md and its pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tools.bench.block_matching import LEFT_RIGHT_PX, SPECK_AREA_PX, UNIQUENESS_PERCENT
from tools.bench.conditions import CONDITIONS, DEFAULT, ILLUMINATION, PLAIN_AMBIENT, TEXTURED
from tools.bench.figures import (
    condition_rows,
    growth_table,
    latency_table,
    maker_table,
    memory_table,
    not_ahead,
    scan_table,
    scene_rows,
    score_table,
    speed_table,
    stage_table,
    trust_table,
)
from tools.bench.makers import REPEATS
from tools.bench.pictures import draw_errors, draw_speed
from tools.bench.posts import PLACES, SEEDS
from tools.bench.simulator_report import SHOWN_SCENES, draw_realism, simulator_tables
from tools.bench.tables import Table

if TYPE_CHECKING:
    from tools.bench.run import Results

HEAD = """# Benchmark

Written by `make bench`: do not edit. Machine: two x86_64 cores.

Every method sees the same scenes of the paper's rig (640x480), ray-traced with exact truth, through the same lens
blur, noise and 8 bits, and is scored by the same code, `moire_sim.score`. Depth range 0.5 to 2 m.
Unless a table says otherwise: fringe or dot amplitude 70 grey levels, ambient light 20, noise 1.5, blur 0.5 px.

Ours: `dense` (one exposure), `phase_shift` (4 steps, each pixel by itself; `3x3`: averaged with the
pixels around it on its surface), `fringe_edges` (the paper's method:
sparse on purpose, so its completeness says nothing). Peers: OpenCV's StereoBM, SGBM 3-way and SGBM HH under random
dots from the same projector, {settings}.
Left-right check {left_right} px, uniqueness {uniqueness} %, specks up to {specks} px dropped. OpenCV leaves out the
left columns whose farthest candidate lies outside the right image; here the pictures are mirrored outwards first, so
that the peers answer everywhere. Their disparities are multiples of 1/16 px: where a whole surface has one disparity
(boards and plates that face the head) their median error is the rounding of that number, small or large by chance.
OpenCV's own fringe patterns (structured_light) are not in the OpenCV package that this project uses: not compared.

How to read the figures. Complete: share of the pixels lit and seen by both cameras that have a depth, and of those
away from edges; "poles alone": of the pixels that show a pole. Off: share of
these depths off by more than 1 px of disparity; "near edges" is up to 10 px from a jump of depth or a border of light.
Right: share of the pixels lit and seen by both cameras that have a depth within 1 px; what a method fills with wrong
depths counts for "complete" and not for "right".
Median: median depth error scaled to 1 m by the square of the depth. Ghosts: share of all pixels that have a depth
where none is to be had, off by more than 3 px.
"""

AHEAD_NOTE = (
    "Every figure in which a peer does better than `dense` or `phase_shift`, by more than 0.05 % or 0.005 mm;"
    " the asterisk marks who is behind."
)
SCENE_NOTE = (
    "Default conditions; the pictures at the end show where the errors are. A surface that turns from the light is"
    " dimmer: fringes have 44 grey levels on slope_1.2, 58 on waves and 61 on both tilts instead of 70, and the noise"
    " floor of four steps at a single pixel, 0.33 mm at 70 grey levels, is 0.53, 0.40 and 0.38 mm there."
)
CONDITION_NOTE = (
    "Means over all scenes (median: the median of the scenes' medians). Square waves and the projector's gamma do not"
    " exist for dots, which are bright or dark: compare with the default."
)
LIGHT_NOTE = (
    "Means over six scenes; where not said otherwise their surfaces carry a checker texture of 30 %, so that stereo"
    " without a projector has something to match. Ambient 1x and 3x: as bright as 1 and 3 times the fringe amplitude;"
    " the exposure is shortened until nothing saturates, the noise stays. Flicker: the ambient light swings by 30 % at"
    " 100 Hz, the frames follow at 60 per second; it matters to phase shifting, whose steps see different light."
)
POSTS_NOTE = (
    f"Means over {len(SEEDS)} scenes that nobody chose: three posts of 20 mm at random places, 0.6 m from the head to"
    " 0.15 m before a wall at 1.3, 1.5 or 1.9 m. `dense` measures a fringe, 17 px, at a time: posts narrower than"
    " 21 px, which are those beyond 1.2 m, and posts nearly whole fringes before the wall, whose fringes run on from"
    " the wall's, are found by what the right camera sees and nobody explains."
)
TRUST_NOTE = (
    "Of the pixels with a confidence above 0.9, wherever they lie, the share off by more than 1 px (aim: 0.05 %); of"
    " the right ones, the share with a confidence above 0.9 (aim: 90 %); the typical depth error by the predicted one,"
    " away from edges (aim: 0.8 to 1.2). Over all scenes under each condition."
)
MAKER_NOTE = (
    f"Precision: standard deviation of a point over {REPEATS} exposures of a slightly turned board, rms of the best"
    " 99.7 %. Planarity: rms distance of the best 99.7 % of the board's points from their best plane. Distance: median"
    " depth error of the board. Step: rms error of the 50 mm between a plate and the wall behind, over three places."
    " Width: mean error of the 100 mm wide plate, from its outermost pixels (one pixel is 0.48, 0.80, 1.20 mm). All in"
    " mm at the distance, not scaled. A precision below the planarity means an error that repeats: rounding to 1/16 px"
    " and a pull towards whole pixels."
)
SPEED_NOTE = (
    "Time from a pair of images (four pairs for `phase_shift`) to depth, and its ratio to StereoBM(128, 15) as OpenCV"
    " makes it, timed turn by turn in one process: medians. Peers with the settings above, over the whole depth range."
    " Idle kernel threads wait as in the nodes (moire_sensor.idle_threads). On a busy machine the milliseconds are too"
    " high; the ratios suffer less."
)
STAGE_NOTE = (
    "`dense` at 640x480, 0.5 to 2 m, stage by stage in the order in which they come: medians; what a stage calls counts"
    " as its own. A stage that is no faster on two threads is bound by memory, or too short to be shared."
)
GROWTH_NOTE = (
    "The same scene with more pixels in the same field of view, fringes as many times wider, and with a wider depth"
    " range, timed turn by turn: medians of ratios. Allowed: 1.3 and 2."
)
MEMORY_NOTE = (
    "Resident memory of a process at its peak, after its first depth with cached kernels; and what it came to more than"
    " Python, numpy, numba and OpenCV."
)
LATENCY_NOTE = (
    "Head, reconstruction and this listener as processes on the same cores, 640x480, a still scene, `dense`, 60 s at"
    " 30 Hz: what became of the sets, and the time from the exposure's stamp to the arrival of the cloud (all outputs)"
    " or of the depth image. Superseded: overtaken by newer ones, as the machine was too slow. As fast as it goes:"
    " pictures made once, sent as results come. Two sets at a time: `parallel_sets:=2`. From import to first depth in"
    " a new process, kernels cached: {:.1f} s."
)
SCAN_NOTE = (
    "How the peers' settings were chosen: mean share of the co-visible pixels right within 1, 1/2 and 1/4 px, less the"
    " share of ghosts, on cylinder_and_box and tilt_0.5; the best of each matcher is used above. SGBM HH was tried on"
    " the dots that SGBM 3-way likes best."
)
PICTURE_NOTE = """## Error maps

Disparity minus true disparity under the default conditions; one pixel of disparity is 3.1, 8.5 and 19 mm of depth at
0.6, 1.0 and 1.5 m. Grey: no depth, as it should be in shadow and where the right camera cannot see.
"""


def tables_of(results: Results) -> list[Table]:
    """Return the tables of everything that was measured."""
    tables = []
    peers = [peer.name for peer in results.peers]
    scenes = scene_rows(results.records)
    if scenes:
        tables.append(score_table("Scenes", SCENE_NOTE, "scene", scenes))
        tables.append(not_ahead("Scenes: where we are not ahead", AHEAD_NOTE, "scene", scenes, peers))
    tables += condition_tables(results, peers)
    if results.posts:
        rows = sorted(condition_rows(results.posts), key=lambda row: PLACES.index(row.place))
        tables.append(score_table("Posts at random places", POSTS_NOTE, "place", rows))
        tables.append(not_ahead("Posts: where we are not ahead", AHEAD_NOTE, "place", rows, peers))
    if results.trusts:
        tables.append(trust_table(results.trusts, TRUST_NOTE))
    if results.makers:
        tables.append(maker_table(results.makers, MAKER_NOTE))
    tables += speed_tables(results)
    tables += simulator_tables(results.simulator)
    if results.trials:
        tables.append(scan_table(results.trials, SCAN_NOTE))
    return tables


def speed_tables(results: Results) -> list[Table]:
    """Return the tables of time and memory."""
    tables = []
    if results.speeds:
        tables.append(speed_table(results.speeds, SPEED_NOTE))
    if results.stages:
        tables.append(stage_table(results.stages, STAGE_NOTE))
    if results.growths:
        tables.append(growth_table(results.growths, GROWTH_NOTE))
    if results.memories:
        tables.append(memory_table(results.memories, MEMORY_NOTE))
    if results.latencies:
        tables.append(latency_table(results.latencies, LATENCY_NOTE.format(results.first_frame_s)))
    return tables


def condition_tables(results: Results, peers: list[str]) -> list[Table]:
    """Return the tables of other conditions, and of other light."""
    tables = []
    usual = [one.name for one in CONDITIONS]
    rows = [row for row in condition_rows(results.records) if row.place in usual]
    rows.sort(key=lambda row: usual.index(row.place))
    if {row.place for row in rows} - {DEFAULT.name}:
        tables.append(score_table("Conditions", CONDITION_NOTE, "condition", rows))
        tables.append(not_ahead("Conditions: where we are not ahead", AHEAD_NOTE, "condition", rows, peers))
    lights = [TEXTURED.name, *(one.name for one in ILLUMINATION), PLAIN_AMBIENT.name]
    lit_scenes = {one.scene for one in results.records if one.condition == ILLUMINATION[0].name}
    rows = condition_rows([one for one in results.records if one.scene in lit_scenes])
    rows = sorted((row for row in rows if row.place in lights), key=lambda row: lights.index(row.place))
    if lit_scenes:
        tables.append(score_table("Light", LIGHT_NOTE, "light", rows))
        tables.append(not_ahead("Light: where we are not ahead", AHEAD_NOTE, "light", rows, peers))
    return tables


def write_report(results: Results, folder: Path) -> None:
    """Write bench.md and images/bench_*.png into a folder."""
    images = folder / "images"
    images.mkdir(parents=True, exist_ok=True)
    settings = ", ".join(f"{one.kind} with {one.dot_px:g} px dots and window {one.window_px}" for one in results.peers)
    head = HEAD.format(
        settings=settings, left_right=LEFT_RIGHT_PX, uniqueness=UNIQUENESS_PERCENT, specks=SPECK_AREA_PX
    )
    parts = [head, *(table.as_markdown() for table in tables_of(results))]
    if results.speeds:
        draw_speed(results.speeds, images / "bench_speed.png")
        parts.append("![Time against image size](images/bench_speed.png)\n")
    if results.simulator.realism:
        shown = [one for one in results.simulator.realism if one.scene in SHOWN_SCENES]
        draw_realism(shown, images / "bench_realistic.png")
        parts.append("![Clean and realistic pictures and error maps](images/bench_realistic.png)\n")
    parts.append(PICTURE_NOTE)
    for scene in dict.fromkeys(one.scene for one in results.records if one.error_px is not None):
        path = images / f"bench_{scene.replace('.', '_')}.png"
        draw_errors(results.records, scene, path)
        parts.append(f"![Error maps of {scene}](images/{path.name})\n")
    (folder / "bench.md").write_text("\n".join(parts), encoding="utf-8")
