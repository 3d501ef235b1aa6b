"""I for a simulated workspace: what its camera sees before anything moves."""

from __future__ import annotations

from palpate.cell import SimulatedCell
from palpate.rendering import Painter, dress, extent, gl_available, png

CAMERA = "workspace"
"""The camera of the world's MJCF that looks at the workspace; without one, a camera that frames all objects."""
WIDTH, HEIGHT = 1024, 768


def workspace_png(cell: SimulatedCell) -> bytes | None:
    """The workspace as PNG bytes; None without a usable OpenGL."""
    import mujoco

    if not gl_available()[0]:
        return None
    spec = cell.world.spec(cell.drawn)
    dress(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with Painter(model, WIDTH, HEIGHT) as painter:
        named = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, CAMERA) >= 0
        camera = CAMERA if named else painter.around(extent(model, data, tuple(cell.world.bodies)))
        return png(painter.paint(data, camera))
