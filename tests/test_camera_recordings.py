"""RealSense and Azure Kinect recordings. The first are written by librealsense's own recorder; the
second by FFmpeg's Matroska writer in the layout that the Kinect's recorder documents, since that
recorder writes only with a camera. The Kinect's geometry is held to OpenCV and published numbers.
"""

from __future__ import annotations

import json
import shutil
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from ropefit.errors import BadInput, WrongUsage
from ropefit.importers.kinect_calibration import COLOUR, DEPTH, Lens, Register, calibration
from ropefit.stages.importing import list_source
from tests import sources
from tests.sources import FOCAL, FRAMES, rendered
from tests.test_importers import brought

# A real Azure Kinect, as its recorder writes it, and what its makers' library says of it in
# 640 x 576 depth and 1920 x 1080 colour images: cx, cy, fx, fy.
DEEP = [
    0.5122697949409485, 0.49451231956481934, 0.4921168386936188, 0.4921667277812958,
    3.1305770874023438, 2.324939012527466, 0.1304156482219696, 3.458651542663574, 3.350114583969116,
    0.6629416346549988, 0.0, 0.0, -0.0000511557373101823, 0.00008132171933539212,
]  # fmt: skip
SHOT = [
    0.4967627227306366, 0.5108628273010254, 0.470907062292099, 0.6274453997612, 0.7227460145950317,
    -2.8855903148651123, 1.6327226161956787, 0.6021990180015564, -2.7196261882781982,
    1.565053105354309, 0.0, 0.0, -0.0001431911950930953, 0.0007828465895727277,
]  # fmt: skip
DEEP_PIXELS = (332.064270, 325.880615, 503.927643, 503.978729)
SHOT_PIXELS = (953.284424, 555.142456, 904.141541, 903.521362)
TURN = cv2.Rodrigues(np.array([0.1, 0.01, -0.005]))[0]
FIXTURES = Path(__file__).parent / "fixtures"
SHIFT = np.array([-0.032, -0.002, 0.004])


def told() -> bytes:
    """A calibration as the Kinect's recorder attaches it."""

    def camera(purpose, numbers, size, turn, shift):
        return {
            "Purpose": purpose,
            "Intrinsics": {"ModelParameterCount": 14, "ModelParameters": numbers},
            "Rt": {"Rotation": turn.ravel().tolist(), "Translation": shift.tolist()},
            "SensorWidth": size[0],
            "SensorHeight": size[1],
        }

    cameras = [
        camera(DEPTH, DEEP, (1024, 1024), np.eye(3), np.zeros(3)),
        camera(COLOUR, SHOT, (4096, 3072), TURN, SHIFT),
    ]
    return json.dumps({"CalibrationInformation": {"Cameras": cameras}}).encode() + b"\0"


def kinect(path: Path, depth_lag: float = 0.0, frames: int = 2, attach: bool = True) -> Path:
    """A wall 1 m away in 320 x 288, colour that changes with the frame, as MJPEG."""
    av = pytest.importorskip("av")
    from fractions import Fraction

    base = Fraction(1, 1000)
    raw = {"allow_raw_vfw": "1", "write_crc32": "0"}  # depth is kept as it is, uncompressed
    with av.open(str(path), "w", format="matroska", options=raw) as file:
        color = file.add_stream("mjpeg", rate=30, options={"qscale": "2"})
        color.width, color.height, color.pix_fmt = 1280, 720, "yuvj422p"
        depth = file.add_stream("rawvideo", rate=30)
        depth.width, depth.height, depth.pix_fmt = 320, 288, "gray16be"
        for stream, name in ((color, "COLOR"), (depth, "DEPTH")):
            stream.metadata["title"] = name
            stream.codec_context.time_base = base
        if attach:
            file.add_attachment("calibration.json", "application/octet-stream", told())
        for n in range(frames):
            image = np.full((720, 1280, 3), (200, 40 + 60 * n, 30), np.uint8)
            shot = av.VideoFrame.from_ndarray(image, format="rgb24").reformat(format="yuvj422p")
            deep = av.VideoFrame.from_ndarray(np.full((288, 320), 1000 + n, np.uint16), "gray16le")
            deep = deep.reformat(format="gray16be")
            for frame, stream, lag in ((shot, color, 0.0), (deep, depth, depth_lag)):
                frame.pts, frame.time_base = round(33 * n + 1e3 * lag), base
                file.mux(stream.encode(frame))
        for stream in (color, depth):
            file.mux(stream.encode())
    # The writer leaves the track's four-character code empty; the recorder's is b16g.
    head = struct.pack("<IiiHH", 40, 320, -288, 1, 16)
    data = path.read_bytes()
    assert data.count(head + bytes(4)) == 1
    path.write_bytes(data.replace(head + bytes(4), head + b"b16g"))
    return path


def test_kinect(tmp_path):
    path = kinect(tmp_path / "k.mkv")
    names = [entry["name"] for entry in list_source(path, "kinect")["contents"]]
    assert names[:2] == ["COLOR", "DEPTH"]
    recording = brought(path, "kinect", camera_pose="0,0,1,0,0,0,1")
    assert recording.frames == [0, 1]
    for frame in recording.frames:
        sight = recording.source.sight(frame)
        assert sight.color is not None
        assert sight.depth is not None
        middle = np.s_[100:180, 120:200]
        np.testing.assert_allclose(sight.depth[middle], 1.0 + 0.001 * frame)
        found = np.median(sight.color[middle].reshape(-1, 3), axis=0)
        np.testing.assert_allclose(found, (200, 40 + 60 * frame, 30), atol=6)  # JPEG
    assert recording.manifest.rgbd is not None
    lens = recording.manifest.rgbd.intrinsics
    assert (lens.width, lens.height) == (320, 288)
    assert lens.fx == pytest.approx(DEEP_PIXELS[2] / 2)


def test_kinect_streams_are_matched_by_time(tmp_path):
    path = kinect(tmp_path / "k.mkv", depth_lag=0.033, frames=3)
    recording = brought(path, "kinect")
    assert recording.frames == [0, 1]  # the first colour and the last depth image have no partner
    sight = recording.source.sight(0)
    assert sight.depth is not None
    assert sight.color is not None
    assert sight.depth[144, 160] == pytest.approx(1.0)
    assert sight.color[144, 160, 1] == pytest.approx(100, abs=6)  # that of the second colour image
    (tmp_path / "late").mkdir()
    late = kinect(tmp_path / "late" / "k.mkv", depth_lag=0.5)
    with pytest.raises(BadInput, match="no colour and depth image within"):
        brought(late, "kinect")


def test_files_that_are_no_kinects(tmp_path):
    bare = kinect(tmp_path / "bare.mkv", attach=False)
    with pytest.raises(BadInput, match="no calibration attached"):
        brought(bare, "kinect")
    (tmp_path / "x.mkv").write_bytes(b"\x1aE\xdf\xa3 and nothing else")
    with pytest.raises(BadInput, match="not readable as an Azure Kinect recording"):
        brought(tmp_path / "x.mkv", "kinect")
    for data in (b"", b"{}", told().replace(b"0.4921168386936188", b"-1.0"), told()[:-60]):
        with pytest.raises(BadInput, match="calibration"):
            calibration(tmp_path / "x.mkv", data)
    with pytest.raises(BadInput, match="the Kinect's are"):
        Register(tmp_path, calibration(tmp_path, told()), (480, 640), (720, 1280))
    assert not (tmp_path / "imported").exists()


def test_kinect_intrinsics_are_those_its_makers_give(tmp_path):
    lenses = calibration(tmp_path, told())
    fx, fy, cx, cy = Register(tmp_path, lenses, (576, 640), (1080, 1920)).matrix
    np.testing.assert_allclose((cx, cy, fx, fy), DEEP_PIXELS, atol=1e-3)
    focal, centre = lenses[COLOUR].pixels((1920, 1080))
    np.testing.assert_allclose((*centre, *focal), SHOT_PIXELS, atol=1e-3)


def opencv(lens: Lens, points: np.ndarray, pixels: tuple[float, ...]) -> np.ndarray:
    """(N, 2) [px] where OpenCV sees points (N, 3) [m] of the rig."""
    cx, cy, fx, fy = pixels
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    k1, k2, k3, k4, k5, k6 = lens.radial
    bent = np.array([k1, k2, *lens.tangential, k3, k4, k5, k6])
    turn = cv2.Rodrigues(lens.rotation)[0]
    return cv2.projectPoints(points, turn, lens.shift, matrix, bent)[0][:, 0]


def test_colour_of_a_depth_pixel_against_opencv(tmp_path):
    """Nine dots in space, painted where OpenCV sees them in both images, meet again."""
    lenses = calibration(tmp_path, told())
    register = Register(tmp_path, lenses, (576, 640), (1080, 1920))
    across, down = np.meshgrid([-0.25, 0.0, 0.25], [-0.15, 0.02, 0.2])
    points = np.stack([across.ravel(), down.ravel(), np.linspace(0.8, 1.2, 9)], axis=1)
    depth, color = np.zeros((576, 640), np.uint16), np.zeros((1080, 1920, 3), np.uint8)
    paint = np.stack([np.arange(9) * 25 + 40, np.full(9, 200), 250 - np.arange(9) * 20], axis=1)
    deep = opencv(lenses[DEPTH], points, DEEP_PIXELS)
    shot = opencv(lenses[COLOUR], points, SHOT_PIXELS)
    for point, at, there, shade in zip(points, deep, shot, paint, strict=True):
        cv2.circle(depth, np.round(at).astype(int).tolist(), 5, float(1000 * point[2]), -1)
        cv2.circle(color, np.round(there).astype(int).tolist(), 5, shade.tolist(), -1)
    image, straight = register(color, depth)
    fx, fy, cx, cy = register.matrix
    for point, shade in zip(points, paint, strict=True):
        u = round(fx * point[0] / point[2] + cx)
        v = round(fy * point[1] / point[2] + cy)
        assert straight[v, u] == pytest.approx(1000 * point[2], abs=1)
        np.testing.assert_array_equal(image[v, u], shade)


def test_realsense(tmp_path):
    path = recorded("realsense-2.59.1.db3", tmp_path / "r.db3")
    the_rendered_rope(path)
    again = recorded("realsense-2.59.1.db3", tmp_path / "again" / "r.db3")
    with pytest.raises(WrongUsage, match="camera_pose"):
        brought(again, "realsense", camera_pose="0,0,0,1,1,1,1")


def test_realsense_bag(tmp_path):
    """Before 2.57 librealsense's recorder made `.bag` files."""
    path = recorded("realsense-2.56.5.bag", tmp_path / "r.bag")
    the_rendered_rope(path)


def recorded(name: str, to: Path) -> Path:
    """What `fixtures/record_realsense.py` wrote, each with its own librealsense."""
    pytest.importorskip("pyrealsense2")
    to.parent.mkdir(exist_ok=True)
    return Path(shutil.copy(FIXTURES / name, to))


def the_rendered_rope(path: Path) -> None:
    kinds = {entry["name"]: entry["kind"] for entry in list_source(path, "realsense")["contents"]}
    assert kinds == {"Depth": "z16", "Color": "rgb8"}
    recording = brought(path, "realsense", camera_pose="0.3,-1.2,0,-0.7071068,0,0,0.7071068")
    assert recording.frames == list(range(FRAMES))
    for frame in recording.frames:
        color, depth = rendered(frame)
        sight = recording.source.sight(frame)
        assert sight.depth is not None
        np.testing.assert_array_equal(sight.color, color)
        # Alignment moves by half a pixel at edges.
        assert np.median(np.abs(sight.depth - depth)) < 0.001
        assert (np.abs(sight.depth - depth) < 0.002).mean() > 0.95
    assert recording.manifest.rgbd is not None
    assert recording.manifest.rgbd.intrinsics.fx == pytest.approx(FOCAL)
    np.testing.assert_allclose(
        np.array(recording.manifest.rgbd.camera_pose)[:3, 3], sources.CAMERA[0]
    )


def test_a_file_that_is_no_realsense_recording(tmp_path):
    pytest.importorskip("pyrealsense2")
    for name in ("x.bag", "x.db3"):
        (tmp_path / name).write_bytes(b"#ROSBAG V2.0\nnothing" * 20)
        with pytest.raises(BadInput, match="not readable as a RealSense recording"):
            brought(tmp_path / name, "realsense")
