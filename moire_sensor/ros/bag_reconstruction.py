"""One bag with a head's topics in, one bag with depth out; interrupted anywhere, it goes on where it was."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo

from moire_sensor.errors import CaptureError, MoireError
from moire_sensor.ros.bag_head import BagHead, head_namespaces
from moire_sensor.ros.bag_message import BagMessage
from moire_sensor.ros.bag_player import recorded_quality
from moire_sensor.ros.bag_reader import Bag
from moire_sensor.ros.bag_task import JOURNAL, BagOutcome, BagTask, Journal
from moire_sensor.ros.bag_topics import type_name_of
from moire_sensor.ros.bag_writer import BagWriter, DiskFullError
from moire_sensor.ros.head_sets import INFO_TOPICS, NANOSECONDS, STREAM_TOPICS
from moire_sensor.ros.qos import publisher_qos
from moire_sensor.ros.reconstruction_report import RECONSTRUCTED, REFUSED

KINDS: dict[str, Any] = {**dict(STREAM_TOPICS.values()), **dict.fromkeys(INFO_TOPICS.values(), CameraInfo)}
DIAGNOSTICS = "/diagnostics"
# Handed on as they are, so that the results can be shown in place without the bag they came from.
PASSED_ON = ("joint_states", "robot_description")
PASSED_ON_GLOBAL = ("/tf", "/tf_static")
# Room that must be there for the first result; after it, twice what the largest took.
FIRST_RESULT_BYTES = 16 << 20


def reconstruct_bag(
    task: BagTask, progress: Callable[[int], object] = int, stop: Callable[[], bool] = bool
) -> BagOutcome:
    """Reconstruct every set of a bag, or those that an interrupted run left; every error is in the outcome.

    ``progress`` is called with 1 for each projector state read; ``stop`` is asked between messages.
    """
    begin_s = time.monotonic()
    outcome = BagOutcome(str(task.source))
    try:
        task.target.parent.mkdir(parents=True, exist_ok=True)
        with Bag(task.source, task.target.parent) as bag:
            heads = [BagHead(name, task.values) for name in head_namespaces(bag.topics)]
            if not heads:
                raise CaptureError(
                    f"the bag {task.source} has no head: left/image_raw, right/image_raw and projector/state in one "
                    f"namespace; its topics are {', '.join(sorted(bag.topics)) or 'none'}"
                )
            writer = BagWriter(task.target, task.storage, task.limits, JOURNAL)
            try:
                BagRun(task, bag, heads, writer, progress).go(outcome, stop)
            finally:
                writer.close()
    except (MoireError, OSError) as error:
        outcome.state, outcome.error = "failed", str(error)
    outcome.wall_s = time.monotonic() - begin_s
    return outcome


class BagRun:
    """The work on one open bag."""

    def __init__(
        self, task: BagTask, bag: Bag, heads: list[BagHead], writer: BagWriter, progress: Callable[[int], object]
    ) -> None:
        self._task, self._bag, self._heads, self._writer, self._progress = task, bag, heads, writer, progress
        self._journal = Journal.of(task, bag.sizes).continued(writer)
        self._period_ns = int(task.values["diagnostics_period_s"] * NANOSECONDS)
        self._restored = False
        self._largest_bytes = FIRST_RESULT_BYTES
        self._undecodable: Counter[str] = Counter()
        self._routes: dict[str, tuple[BagHead, str]] = {
            f"{head.namespace}/{topic}": (head, topic) for head in heads for topic in KINDS
        }
        self._passed_on = {
            name: recorded_quality(bag.topics[name].qualities)
            for name in (*PASSED_ON_GLOBAL, *(f"{head.namespace}/{topic}" for head in heads for topic in PASSED_ON))
            if name in bag.topics and writer.knows(bag.topics[name].type_name)
        }

    def go(self, outcome: BagOutcome, stop: Callable[[], bool]) -> None:
        """Work to the end, or until ``stop``; raises MoireError where the bag cannot be written."""
        if self._journal.outcome is not None:
            vars(outcome).update(self._journal.outcome, done_before=True)
            return
        self._writer.note(self._journal.texts())
        try:
            finished = self._read(outcome, stop)
        except DiskFullError:
            # The room that is kept free takes the end of the part.
            self._save()
            raise
        finally:
            self._tell(outcome)
        if finished:
            self._finish(outcome)
        else:
            outcome.state = "interrupted"
        self._save()

    def _finish(self, outcome: BagOutcome) -> None:
        """Judge a bag that was read to its end."""
        outcome.state = "damaged" if outcome.damages else "whole"
        if not outcome.results:
            refused = ", ".join(f"{reason} {number}" for reason, number in outcome.refused.items())
            outcome.state = "failed"
            outcome.error = f"no set could be reconstructed of {outcome.sets}: {refused or 'no whole set in it'}"
        self._journal.outcome = asdict(outcome)

    def _tell(self, outcome: BagOutcome) -> None:
        """Note in the outcome how far the work has come."""
        outcome.sets = sum(head.matched for head in self._heads)
        counts = sum((head.ledger.counts for head in self._heads), Counter())
        outcome.results = counts[RECONSTRUCTED]
        outcome.refused = {
            name.removeprefix(REFUSED): number for name, number in sorted(counts.items()) if name.startswith(REFUSED)
        }
        outcome.damages = list(self._bag.damages)
        for topic, number in sorted(self._undecodable.items()):
            outcome.damages.append(f"{number} messages of {topic} cannot be decoded")

    def _read(self, outcome: BagOutcome, stop: Callable[[], bool]) -> bool:
        """Go through the messages, those that were done before only for what they mean to the rest."""
        before = self._journal.messages
        first_ns = last_ns = 0
        for number, message in enumerate(self._bag.messages({*self._routes, *self._passed_on}), start=1):
            first_ns, last_ns = first_ns or message.time_ns, message.time_ns
            outcome.bag_s = (last_ns - first_ns) / NANOSECONDS
            if number <= before:
                self._jobs_of(message)
            else:
                self._restore()
                self._work_on(message)
                self._journal.messages = number
            if self._writer.is_due:
                self._save()
            if stop():
                return False
        self._restore()
        for head in self._heads:
            head.finish()
        self._report(last_ns)
        return True

    def _restore(self) -> None:
        """Take up, once, the counts of the interrupted run, now that its messages were fed."""
        if not self._restored:
            self._restored = True
            for head in self._heads:
                if head.namespace in self._journal.heads:
                    head.restore(self._journal.heads[head.namespace])

    def _save(self) -> None:
        """Complete the part, with all that is needed to go on from here."""
        if self._restored:
            self._journal.heads = {head.namespace: head.state() for head in self._heads}
        self._writer.commit(self._journal.texts())

    def _work_on(self, message: BagMessage) -> None:
        """Write what a message leads to; all of it or, where the disk is full, nothing."""
        self._writer.ensure_room(2 * self._largest_bytes)
        if message.time_ns >= self._journal.report_ns or message.time_ns < self._journal.report_ns - self._period_ns:
            if self._journal.report_ns:
                self._report(message.time_ns)
            self._journal.report_ns = message.time_ns + self._period_ns
        if message.topic in self._passed_on:
            type_name = self._bag.topics[message.topic].type_name
            qualities = [self._passed_on[message.topic]]
            self._writer.write(message.topic, type_name, qualities, message.time_ns, message.serialized)
        for head, job in self._jobs_of(message):
            size = 0
            for topic, result in head.work(job, self._task.topics, message.time_ns / NANOSECONDS):
                size += self._put_message(topic, result, message.time_ns)
            self._largest_bytes = max(self._largest_bytes, size)

    def _jobs_of(self, message: BagMessage) -> list[tuple[BagHead, Any]]:
        """Feed a message to its head; return what there is to do then."""
        if message.topic not in self._routes:
            return []
        head, topic = self._routes[message.topic]
        if topic == STREAM_TOPICS["state"][0]:
            self._progress(1)
        found = self._bag.topics[message.topic].type_name
        try:
            if found != type_name_of(KINDS[topic]):
                raise TypeError(f"it is {found}, {type_name_of(KINDS[topic])} is needed")
            decoded = deserialize_message(message.serialized, KINDS[topic])
        except (RuntimeError, TypeError):
            self._undecodable[message.topic] += 1
            return []
        return [(head, job) for job in head.feed(message.topic, decoded)]

    def _report(self, time_ns: int) -> None:
        """Write the diagnostics of every head."""
        statuses = [status for head in self._heads for status in head.statuses(time_ns / NANOSECONDS)]
        message = DiagnosticArray(status=statuses)
        message.header.stamp = Time(sec=time_ns // NANOSECONDS, nanosec=time_ns % NANOSECONDS)
        self._put_message(DIAGNOSTICS, message, time_ns)

    def _put_message(self, topic: str, message: Any, time_ns: int) -> int:
        """Write a message as the node publishes it; return its size in bytes."""
        serialized = serialize_message(message)
        self._writer.write(topic, type_name_of(type(message)), [publisher_qos()], time_ns, serialized)
        return len(serialized)
