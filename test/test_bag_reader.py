"""Reading bags: whatever wrote them, whole or damaged, honest or not."""

from __future__ import annotations

import random
import shutil
import struct
import sys
from pathlib import Path

import lz4.frame
import pytest
import yaml
from bag_runs import copy_bag, first_sets
from rosbags.rosbag2 import CompressionMode, Reader
from rosbags.rosbag2.storage_mcap import McapWriter

from moire_sensor.errors import CaptureError
from moire_sensor.ros.bag_message import BagMessage
from moire_sensor.ros.bag_metadata import ROOT
from moire_sensor.ros.bag_reader import Bag, read_messages
from moire_sensor.ros.bag_unpack import unpack, unpack_message
from moire_sensor.ros.mcap_records import CHUNK, DATA_END, FOOTER, RECORD_HEADER, chunk_content

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

Content = list[tuple[str, int, bytes]]
VARIANTS = [
    ("mcap", "none"), ("mcap", "file"), ("mcap", "message"), ("mcap", "storage"),
    ("sqlite3", "none"), ("sqlite3", "file"), ("sqlite3", "message"),
]  # fmt: skip


@pytest.fixture(scope="session")
def two_sets(dense_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The head's messages of two exposures."""
    return copy_bag(dense_bag, tmp_path_factory.mktemp("two") / "bag", first_sets(2))


def storage_file(bag: Path) -> Path:
    return next(path for path in bag.iterdir() if path.name != "metadata.yaml")


def oracle(bag: Path) -> Content:
    """What the rosbags library reads."""
    with Reader(bag) as reader:
        return [(connection.topic, time_ns, bytes(data)) for connection, time_ns, data in reader.messages()]


def read(path: Path) -> tuple[Content, list[str]]:
    """Messages and damages."""
    with Bag(path) as bag:
        content = [(one.topic, one.time_ns, one.serialized) for one in bag.messages()]
        return content, bag.damages


@pytest.mark.parametrize(("storage", "compression"), VARIANTS)
def test_every_storage_and_compression_reads_alike(
    two_sets: Path, tmp_path: Path, storage: str, compression: str
) -> None:
    bag = copy_bag(two_sets, tmp_path / "bag", list, storage, compression)
    expected = oracle(two_sets)
    assert len(expected) > 12
    assert read(bag) == (expected, [])
    if compression != "message":
        # A lone file is a bag too; of compressed messages no file tells, but each shows it.
        assert read(storage_file(bag)) == (expected, [])
    (bag / "metadata.yaml").unlink()
    content, damages = read(bag)
    assert content == expected
    assert damages == ["metadata.yaml is missing"]


def test_messages_of_overlapping_chunks_come_in_the_order_of_time(two_sets: Path, tmp_path: Path) -> None:
    def shuffled(messages: list[BagMessage]) -> list[BagMessage]:
        random.Random(3).shuffle(messages)
        return messages

    bag = copy_bag(two_sets, tmp_path / "bag", shuffled)
    assert sorted(read(bag)[0]) == sorted(oracle(two_sets))
    times = [time_ns for _, time_ns, _ in read(bag)[0]]
    assert times == sorted(times)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("share", [0.999, 0.7, 0.3, 0.01])
def test_a_truncated_file_gives_all_that_is_left(two_sets: Path, tmp_path: Path, storage: str, share: float) -> None:
    bag = copy_bag(two_sets, tmp_path / "bag", list, storage)
    expected = oracle(bag)
    file = storage_file(bag)
    size = int(share * file.stat().st_size)
    with file.open("r+b") as stream:
        stream.truncate(size)
    if storage == "sqlite3" and share == 0.01:
        with pytest.raises(CaptureError, match=r"bag\.db3"):
            read(bag)
        return
    content, damages = read(bag)
    assert [one for one in content if one not in expected] == []
    assert any(file.name in text for text in damages) or len(content) == len(expected)
    if storage == "mcap":
        # Every message that ends before the cut: sizes of messages, and 31 bytes of record before each.
        room = size - 20_000
        fitting = 0
        for _, _, data in expected:
            room -= len(data) + 31
            fitting += room > 0
        assert fitting - 1 <= len(content) <= len(expected)
        assert len(content) == len(expected) or any("messages of" in text for text in damages)


def test_a_damaged_chunk_costs_only_its_own_messages(dense_bag: Path, tmp_path: Path) -> None:
    bag = copy_bag(dense_bag, tmp_path / "bag", first_sets(4), "mcap", "storage")
    expected = oracle(bag)
    file = storage_file(bag)
    data = bytearray(file.read_bytes())
    # The first chunk follows the magic and the header; beyond its own header lie compressed data.
    offset = 8 + RECORD_HEADER.size + RECORD_HEADER.unpack_from(data, 8)[1]
    kind, length = RECORD_HEADER.unpack_from(data, offset)
    assert kind == CHUNK
    data[offset + length // 2 : offset + length // 2 + 64] = bytes(64)
    file.write_bytes(data)
    content, damages = read(bag)
    assert 0 < len(content) < len(expected)
    assert [one for one in content if one not in expected] == []
    assert any(f"{file.name}: chunk of {length} bytes" in text and "0 of" in text for text in damages)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_thousand_damaged_files_are_read_or_refused(two_sets: Path, tmp_path: Path, storage: str) -> None:
    """No crash, and no error but our own; without images, so that damage hits lengths and types most."""

    def no_images(messages: list[BagMessage]) -> list[BagMessage]:
        return [one for one in messages if not one.topic.endswith("image_raw")]

    small = copy_bag(two_sets, tmp_path / "small", no_images, storage)
    file = storage_file(small)
    whole = file.read_bytes()
    random_of = random.Random(5)
    target = tmp_path / f"damaged{file.suffix}"
    unreadable = damaged = 0
    for _ in range(500):
        data = bytearray(whole)
        for _ in range(random_of.randint(1, 8)):
            position = random_of.randrange(len(data))
            data[position] = random_of.choice([0, 0x7F, 0xFF, random_of.randrange(256)])
        if random_of.random() < 0.3:
            del data[random_of.randrange(len(data)) :]
        target.write_bytes(data)
        try:
            _, damages = read(target)
            damaged += bool(damages)
        except CaptureError:
            unreadable += 1
    # Some damage hits what nothing guards, such as a number in a message; much of it is noticed.
    assert damaged > 10
    assert unreadable < 400


def metadata_of(bag: Path) -> dict[str, object]:
    content: dict[str, dict[str, object]] = yaml.safe_load((bag / "metadata.yaml").read_text())
    return content[ROOT]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"relative_file_paths": "../../etc/passwd"}, "is missing"),
        ({"relative_file_paths": 7}, "does not describe a bag"),
        ({"topics_with_message_count": [{"topic_metadata": {"name": "/head/left/image_raw"}, "message_count": 10**18}]},
         f"2 of {10**18} messages of /head/left/image_raw are there"),
        ({"relative_file_paths": ["bag.mcap", "bag_1.mcap"]}, "bag_1.mcap is missing"),
    ],
)  # fmt: skip
def test_metadata_are_not_trusted(two_sets: Path, tmp_path: Path, change: dict[str, object], says: str) -> None:
    bag = tmp_path / "bag"
    shutil.copytree(two_sets, bag)
    information = {**metadata_of(bag), **change}
    (bag / "metadata.yaml").write_text(yaml.safe_dump({ROOT: information}))
    content, damages = read(bag)
    assert content == oracle(two_sets)
    assert any(says in text for text in damages), damages


@pytest.mark.parametrize(
    "text",
    ["[" * 100_000, "a: &a [x]\n", "- " * 50_000, "\0", "!!python/object/apply:os.system [exit]", "x" * (1 << 23)],
    ids=["deep", "other", "deep block", "binary", "code", "large"],
)
def test_hostile_metadata_are_refused_and_the_files_read(two_sets: Path, tmp_path: Path, text: str) -> None:
    bag = tmp_path / "bag"
    shutil.copytree(two_sets, bag)
    (bag / "metadata.yaml").write_text(text)
    content, damages = read(bag)
    assert content == oracle(two_sets)
    assert len(damages) == 1
    assert "metadata.yaml" in damages[0]


def test_what_claims_to_be_small_is_not_unpacked_beyond_it() -> None:
    bomb = zstd.compress(bytes(1 << 26))
    assert len(bomb) < 1 << 14
    with pytest.raises(CaptureError, match="more than the 1000 bytes"):
        unpack(bomb, "zstd", 1000)
    with pytest.raises(CaptureError, match="claims 1099511627776 bytes"):
        unpack(bomb, "zstd", 1 << 40)
    with pytest.raises(CaptureError, match="'brotli'"):
        unpack(bomb, "brotli", 1000)
    with pytest.raises(CaptureError, match="is cut"):
        unpack_message(bomb[:-4])


def test_a_record_that_claims_more_than_the_file_holds_is_named(two_sets: Path, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    shutil.copytree(two_sets, bag)
    file = storage_file(bag)
    data = bytearray(file.read_bytes())
    offset = 8 + RECORD_HEADER.size + RECORD_HEADER.unpack_from(data, 8)[1]
    data[offset + 1 : offset + 9] = struct.pack("<Q", 1 << 60)
    file.write_bytes(data)
    content, damages = read(bag)
    # The index at the end still tells where the chunks are.
    assert content == oracle(two_sets)
    assert len(damages) == 1
    assert "no whole record at byte" in damages[0]


@pytest.mark.parametrize("name", ["nothing", "empty.mcap", "text.mcap", "text.db3", "picture.png", "folder"])
def test_what_is_no_bag_is_refused_in_one_sentence(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name == "folder":
        path.mkdir()
    elif name != "nothing":
        path.write_text("" if name == "empty.mcap" else "no bag")
    with pytest.raises(CaptureError, match="cannot read the bag") as caught:
        read(path)
    assert name in str(caught.value)


def test_read_messages_demands_a_whole_bag(two_sets: Path, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    shutil.copytree(two_sets, bag)
    with storage_file(bag).open("r+b") as stream:
        stream.truncate(700_000)
    with pytest.raises(CaptureError, match="is damaged"):
        list(read_messages(bag))


def test_lz4_chunks_are_read(two_sets: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """rosbags writes none; other recorders do."""

    def with_lz4(self: McapWriter, path: Path, compression: CompressionMode) -> None:
        original(self, path, compression)
        self.compression, self.compressor = "lz4", lz4.frame.compress

    original = McapWriter.__init__
    monkeypatch.setattr(McapWriter, "__init__", with_lz4)
    bag = copy_bag(two_sets, tmp_path / "bag")
    assert storage_file(bag).read_bytes().count(b"\3\0\0\0lz4") >= 2
    assert read(bag) == (oracle(two_sets), [])


def test_messages_outside_of_chunks_are_read(two_sets: Path, tmp_path: Path) -> None:
    """As ``ros2 bag record --storage-preset-profile fastwrite`` writes them, here without any index."""
    data = storage_file(two_sets).read_bytes()
    kept = bytearray(data[:8])
    offset = 8
    while offset < len(data) - 8:
        kind, length = RECORD_HEADER.unpack_from(data, offset)
        end = offset + RECORD_HEADER.size + length
        if kind == 1:
            kept += data[offset:end]
        elif kind == CHUNK:
            kept += chunk_content(data[offset + RECORD_HEADER.size : end], cut=False)
        offset = end
    for kind, content in ((DATA_END, bytes(4)), (FOOTER, bytes(20))):
        kept += RECORD_HEADER.pack(kind, len(content)) + content
    file = tmp_path / "bag.mcap"
    file.write_bytes(kept + data[:8])
    assert read(file) == (oracle(two_sets), [])
    with file.open("r+b") as stream:
        stream.truncate(len(kept) // 2)
    content, damages = read(file)
    assert content == oracle(two_sets)[: len(content)]
    assert len(content) >= 5
    assert len(damages) == 1
