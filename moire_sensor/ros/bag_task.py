"""What to do with one bag, what came of it, and what is noted in between to go on after an interruption."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from moire_sensor.errors import CaptureError
from moire_sensor.ros.bag_writer import BagWriter, Limits

# Name of the custom text in metadata.yaml that holds the journal.
JOURNAL = "moire_sensor_journal"
VERSION = 1
DEFAULT_TOPICS = (
    "depth/image_rect", "depth/camera_info", "depth/sigma", "confidence/image", "status/image", "fringe_order/image",
    "points",
)  # fmt: skip


@dataclass(frozen=True)
class BagTask:
    """What to do with one bag.

    Attributes
    ----------
    source, target : the bag to read, and the folder of the bag to write.
    values : parameter values of the reconstruction node.
    topics : result topics to write, relative to the head's namespace; the diagnostics always are.
    storage, limits : how the bag is written.
    threads : of the kernels; 0 takes what there is.
    """

    source: Path
    target: Path
    values: Mapping[str, Any]
    topics: tuple[str, ...] = DEFAULT_TOPICS
    storage: str = "mcap"
    limits: Limits = field(default_factory=Limits)
    threads: int = 0


@dataclass
class BagOutcome:
    """What became of a bag.

    Attributes
    ----------
    state : whole, damaged (all that is readable was reconstructed), failed, or interrupted.
    done_before : whether an earlier run had finished it.
    sets, results : whole sets in the bag, and results written.
    refused : number of refused sets by reason.
    damages : what could not be read.
    error : why it failed.
    bag_s, wall_s : time that the bag covers, and that it took, seconds.
    """

    source: str
    state: str = "failed"
    done_before: bool = False
    sets: int = 0
    results: int = 0
    refused: dict[str, int] = field(default_factory=dict)
    damages: list[str] = field(default_factory=list)
    error: str = ""
    bag_s: float = 0.0
    wall_s: float = 0.0


@dataclass
class Journal:
    """Where the work on a bag stands; everything that the first ``messages`` messages led to is written.

    Attributes
    ----------
    source, settings : what the results were made from; a run from something else must not go on with them.
    report_ns : record time from which the next diagnostics are due.
    heads : state of each head.
    outcome : of a finished bag, else None.
    """

    source: dict[str, int]
    settings: dict[str, Any]
    messages: int = 0
    report_ns: int = 0
    heads: dict[str, Any] = field(default_factory=dict)
    outcome: dict[str, Any] | None = None

    @classmethod
    def of(cls, task: BagTask, sizes: Mapping[str, int]) -> Journal:
        """Return the journal of a task not begun yet."""
        settings = {**task.values, "topics": list(task.topics), "storage": task.storage, "version": VERSION}
        return cls(dict(sizes), settings)

    def continued(self, writer: BagWriter) -> Journal:
        """Return the journal in the bag that was begun, or this one.

        Raises
        ------
        CaptureError
            The bag was made from another source or with other settings.
        """
        text = writer.custom.get(JOURNAL)
        if text is None:
            return self
        try:
            found = Journal(**json.loads(text))
            differing = {name for name in found.settings.keys() | self.settings.keys()
                         if found.settings.get(name) != self.settings.get(name)}  # fmt: skip
        except (ValueError, TypeError, AttributeError) as error:
            raise CaptureError(f"the journal in {writer.folder} is damaged: remove the folder") from error
        if differing:
            raise CaptureError(
                f"{writer.folder} was made with another {', '.join(sorted(differing))}; give the same, or another --out"
            )
        if found.source != self.source:
            raise CaptureError(f"{writer.folder} was made from another bag; choose another --out")
        return found

    def texts(self) -> dict[str, str]:
        """Return the journal as the bag's custom text."""
        return {JOURNAL: json.dumps(asdict(self))}
