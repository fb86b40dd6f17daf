"""A run in the browser by viser: a server on this machine with a slider over the frames."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from ropefit.errors import StageFailed
from ropefit.reporting.contents import RunContents
from ropefit.viewing.layers import Layer, frames


def serve_run(
    run: RunContents, port: int, say: Callable[[str], None], stop: threading.Event | None = None
) -> None:
    """Serve until `stop` is set, or for ever. Raises StageFailed where viser is missing or the port
    is taken."""
    try:
        import viser
    except ImportError:
        raise StageFailed("viser is not installed; run pip install 'ropefit[viser]'")
    try:
        server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    except OSError as error:
        raise StageFailed(f"port {port}: {error.strerror or error}; give another --port")
    steps = list(frames(run))
    g = run.observations.gravity
    if np.linalg.norm(g) > 0:
        server.scene.set_up_direction(-g / np.linalg.norm(g))
    slider = server.gui.add_slider("frame", 0, max(len(steps) - 1, 1), 1, 0)
    shown: list[Any] = []

    def show() -> None:
        number = min(int(slider.value), len(steps) - 1)
        with server.atomic():
            for handle in shown:
                handle.remove()
            shown[:] = [_add(server, layer) for layer in steps[number][2] if len(layer.points) > 1]

    slider.on_update(lambda _: show())
    show()
    say(f"view: http://127.0.0.1:{server.get_port()} (stop it with Ctrl-C)")
    try:
        (stop or threading.Event()).wait()
    finally:
        server.stop()


def _add(server: Any, layer: Layer) -> Any:
    points = layer.points.astype(np.float32)
    if layer.line:
        pairs = np.stack([points[:-1], points[1:]], axis=1)
        colours = np.broadcast_to(np.array(layer.colour, np.uint8), pairs.shape)
        return server.scene.add_line_segments(f"/{layer.name}", pairs, colours, line_width=3.0)
    return server.scene.add_point_cloud(
        f"/{layer.name}", points, layer.colour, point_size=2 * layer.radius
    )
