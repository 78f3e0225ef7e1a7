"""Definitions of messages: the hashes of their types are those of ROS 2 Humble and Jazzy."""

import pytest

from tracker.formats.ros.definitions import DEFINITIONS, message_definition, parts_of

KINDS = sorted({kind for kind in DEFINITIONS if not kind.startswith(("vision_msgs", "builtin_interfaces"))})


@pytest.mark.parametrize("release", ["ROS2_HUMBLE", "ROS2_JAZZY"])
def test_hashes_are_those_of_ros(release: str) -> None:
    """RIHS01 hashes cover names and types of all fields, and of all parts (REP-2016)."""
    typesys = pytest.importorskip("rosbags.typesys")
    theirs, ours = typesys.get_typestore(typesys.Stores[release]), typesys.get_typestore(typesys.Stores.EMPTY)
    for kind in KINDS:
        name = kind.replace("/", "/msg/")
        ours.register({key: value for key, value in typesys.get_types_from_msg(message_definition(kind), name).items() if key not in ours.fielddefs})
        assert ours.hash_rihs01(name) == theirs.hash_rihs01(name), kind


def test_a_definition_has_all_its_parts_once() -> None:
    text = message_definition("vision_msgs/Detection2DArray")
    named = [line.removeprefix("MSG: ") for line in text.splitlines() if line.startswith("MSG: ")]
    assert sorted(named) == sorted(parts_of("vision_msgs/Detection2DArray")[1:])
    assert len(set(named)) == len(named) == 12
