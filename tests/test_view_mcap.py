"""`ropefit view --out run.mcap`: what ROS 2 reads of it is what the run holds."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.artifacts import write
from ropefit.errors import WrongUsage
from ropefit.reporting.contents import RunContents
from ropefit.viewing.layers import frames
from ropefit.viewing.mcap import write_mcap
from tests.report_runs import observations


def test_the_file_holds_every_frame(ropefit, tmp_path) -> None:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    o = observations()
    (tmp_path / "run").mkdir()
    write(tmp_path / "run" / o.file_name, o)
    out = tmp_path / "shown" / "run.mcap"
    assert ropefit.json("view", "--run", "run", "--out", str(out))["file"] == str(out)
    store = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([out], default_typestore=store) as reader:
        told = [
            (connection.topic, time, reader.deserialize(raw, connection.msgtype))
            for connection, time, raw in reader.messages()
        ]
    expected = [(time, layer) for _, time, layers in frames(RunContents(o)) for layer in layers]
    assert len(told) == len(expected)
    for time, layer in expected:
        topic = f"/rope/{layer.name.replace(' ', '_')}"
        (marker,) = [m for name, at, m in told if name == topic and at == round(time * 1e9)]
        points = np.array([[p.x, p.y, p.z] for p in marker.points]).reshape(-1, 3)
        np.testing.assert_array_equal(points, layer.points)
        assert marker.scale.x == pytest.approx(2 * layer.radius)
    assert list(out.parent.iterdir()) == [out]
    with pytest.raises(WrongUsage, match="is a folder"):
        write_mcap(RunContents(o), tmp_path)
