"""The SROS2 policy gives each node what the running node has in the graph, and not one topic or service more."""

from __future__ import annotations

import os
import subprocess
import sysconfig
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
from ros_head import Listener, running
from ros_process import TIMEOUT_S, ros_node
from source_scan import ROOT
from test_ros_capture_player import write_folder

from moire_sensor.resources import resource_path
from moire_sensor.ros.viewer_inputs import STREAMS

NAMESPACE = "/head"
RIGHTS = {
    ("topics", "publish"): "get_publisher_names_and_types_by_node",
    ("topics", "subscribe"): "get_subscriber_names_and_types_by_node",
    ("services", "reply"): "get_service_names_and_types_by_node",
    ("services", "request"): "get_client_names_and_types_by_node",
}
# Loading these can run code that a file or message brings along.
UNSAFE = ("import pickle", "yaml.load(", "yaml.unsafe_load", "allow_pickle=True", "eval(", "exec(", "import marshal",
          "import shelve", "import dill", "shell=True")  # fmt: skip


def allowed(node: str) -> dict[str, set[str]]:
    """Full names that the policy allows a node, by right."""
    root = ET.parse(resource_path("config/sros2_policy.xml")).getroot()
    profile = root.find(f".//enclave[@path='{NAMESPACE}/{node}']/profiles/profile[@node='{node}']")
    assert profile is not None
    assert profile.get("ns") == NAMESPACE
    found: dict[str, set[str]] = {right: set() for _, right in RIGHTS}
    for rule in profile:
        for right, verdict in rule.attrib.items():
            assert verdict == "ALLOW"
            found[right] |= {full_name(node, entry.text or "") for entry in rule}
    return found


def full_name(node: str, name: str) -> str:
    """What sros2 makes of a name in a policy: absolute, private (~/) or relative to the node's namespace."""
    private = f"{NAMESPACE}/{node}" + name[1:]
    return name if name.startswith("/") else private if name.startswith("~/") else f"{NAMESPACE}/{name}"


def in_graph(asker: Any, node: str) -> dict[str, set[str]]:
    return {
        right: {name for name, _ in getattr(asker, question)(node, NAMESPACE)}
        for (_, right), question in RIGHTS.items()
    }


@pytest.mark.parametrize("name", ["reconstruction", "virtual_head", "capture_player", "moire_viewer"])
def test_the_policy_is_what_the_running_node_has(name: str, tmp_path: Path) -> None:
    rights = allowed(name)
    parameters: tuple[str, ...] = ()
    if name == "capture_player":
        parameters = (f"folder:={write_folder(tmp_path / 'capture')}", "wait_for_subscribers:=100")
    if name == "moire_viewer":
        parameters = ("port:=0",)
        # It subscribes to nothing until somebody opens the page.
        assert rights["subscribe"] == {f"{NAMESPACE}/{topic}" for topic, *_ in STREAMS.values()}
        rights["subscribe"] = set()
    with ros_node("asker") as node, running(name, *parameters):
        asker = Listener(node)
        asker.wait(lambda: in_graph_or_nothing(node, name) == rights, f"the graph of {name}: {rights}")


def in_graph_or_nothing(asker: Any, node: str) -> dict[str, set[str]]:
    """What the graph knows of a node; nothing while it does not know the node."""
    known = (node, NAMESPACE) in asker.get_node_names_and_namespaces()
    return in_graph(asker, node) if known else {}


def test_two_nodes_of_one_process_have_the_rights_of_both() -> None:
    root = ET.parse(resource_path("config/sros2_policy.xml")).getroot()
    alone, together = (
        [
            ET.tostring(profile, encoding="unicode").split()
            for enclave in enclaves
            for profile in root.findall(f".//enclave[@path='{NAMESPACE}/{enclave}']/profiles/profile")
        ]
        for enclaves in (("reconstruction", "virtual_head"), ("moire_demo",))
    )
    assert len(together) == 2
    assert together == alone


def test_the_policy_is_shaped_as_sros2_reads_it() -> None:
    """Element names, attributes and nesting of its schema, version 0.2.0."""
    root = ET.parse(resource_path("config/sros2_policy.xml")).getroot()
    assert (root.tag, root.attrib) == ("policy", {"version": "0.2.0"})
    assert [child.tag for child in root] == ["enclaves"]
    nesting = {"enclaves": {"enclave"}, "enclave": {"profiles"}, "profiles": {"profile"},
               "profile": {"topics", "services"}, "topics": {"topic"}, "services": {"service"}}  # fmt: skip
    for element in root.iter():
        if element.tag in nesting:
            assert {child.tag for child in element} == nesting[element.tag] or element.tag == "profile"
            assert {child.tag for child in element} <= nesting[element.tag]
            assert len(element)
        if element.tag in ("topics", "services"):
            assert set(element.attrib) <= {right for tag, right in RIGHTS if tag == element.tag}


def test_without_keys_a_secured_node_says_so_in_one_line_and_ends(tmp_path: Path) -> None:
    environment = {**os.environ, "ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce",
                   "ROS_SECURITY_KEYSTORE": str(tmp_path)}  # fmt: skip
    command = [str(Path(sysconfig.get_path("scripts")) / "reconstruction"), "--ros-args", "--enclave", "/head/x"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=TIMEOUT_S)
    assert done.returncode == 1
    said = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(said) == 1
    assert "SECURITY ERROR" in said[0]
    assert "Traceback" not in done.stderr


def test_nothing_from_outside_is_loaded_unsafely() -> None:
    # A head and the processes that render for it talk over a socket pair that nobody else has.
    among_themselves = {"render_worker.py"}
    for folder in ("moire_sensor", "moire_sim"):
        for path in (ROOT / folder).rglob("*.py"):
            text = "" if path.name in among_themselves else path.read_text()
            assert not [unsafe for unsafe in UNSAFE if unsafe in text], path
