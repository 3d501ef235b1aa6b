"""Objects of several bodies as one."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from palpate.mjcf.inertial import total_inertia

CLUB = """<mujoco><worldbody>
<body name="club" pos="1 2 3" euler="20 0 40"><freejoint/>
  <body pos=".1 0 0" euler="0 30 0"><geom type="box" size=".02 .03 .04" pos=".01 .02 0" mass=".1"/>
    <body pos="0 .1 0"><geom type="capsule" size=".02 .1" mass=".3"/></body></body>
  {own}
</body>
<body name="other"><freejoint/><geom size=".1"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize("own", ["", '<geom size=".03" mass=".2"/>'])
def test_whole_has_the_inertia_of_the_compiled_subtree(own: str) -> None:
    model = mujoco.MjModel.from_xml_string(CLUB.format(own=own))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    result, club = total_inertia(model, "club"), model.body("club").id
    pose = data.xpos[club], data.xmat[club].reshape(3, 3)
    assert result.mass == pytest.approx(model.body_subtreemass[club])
    assert pose[0] + pose[1] @ result.com == pytest.approx(data.subtree_com[club])
    # The mass matrix of a free body: its last three rows are the inertia about its frame.
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    offset = result.mass * (result.com @ result.com * np.eye(3) - np.outer(result.com, result.com))
    assert mass[3:6, 3:6] == pytest.approx(result.tensor + offset)
