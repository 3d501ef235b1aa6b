"""A seven-axis arm of a user's own, as its folder would have it: an MJCF and a short YAML."""

from __future__ import annotations

from pathlib import Path

LINKS = [  # position in the one before, and the axis its joint turns about
    ((0, 0, 0.16), "0 0 1"),
    ((0, 0, 0.2), "0 1 0"),
    ((0, 0, 0.2), "0 0 1"),
    ((0, 0, 0.22), "0 -1 0"),
    ((0, 0, 0.2), "0 0 1"),
    ((0, 0, 0.2), "0 1 0"),
    ((0, 0, 0.08), "0 0 1"),
]
FINGER = """<body name="{side}" pos="0 0 0.06" {turned}>
  <joint name="{side}_slide" type="slide" axis="0 1 0" range="0 0.05" damping="5" armature="0.1"/>
  <geom type="box" pos="0 0.012 0.02" size="0.01 0.006 0.02" mass="0.02"/></body>"""
HAND = f"""<body name="gripper" pos="0 0 0.05" quat="0 0 0 1">
  <geom type="box" pos="0 0 0.03" size="0.03 0.09 0.028" mass="0.6"/>
  {FINGER.format(side="left", turned="")}{FINGER.format(side="right", turned='quat="0 0 0 1"')}</body>"""
CAP = """v 0 0 0
v 0.1 0 0
v 0 0.1 0
v 0 0 0.1
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""
SEEN = '<geom type="mesh" mesh="cap" contype="0" conaffinity="0" mass="0"/>'
SHEET = """like: fr3
label: an arm of one's own
mjcf: my_arm.xml
joints: [j1, j2, j3, j4, j5, j6, j7]
home: [0, -0.17, 0, -1.92, 0, 1.3916, 0]
velocity: [2, 2, 2, 2, 3, 3, 3]
torque: [150, 150, 100, 100, 50, 30, 30]
payload: 2.0
workspace: {min: [-0.9, -0.9, -0.6], max: [0.9, 0.9, 1.3]}
reach: {nearest: 0.42, farthest: 0.7, preferred: 0.55, shoulder: 0.36, wrist: 0.23, stretched: 0.76}
hand:
  body: gripper
  tcp: [0, 0, 0.1]
  palm: 0.029
  fingers: [left_slide, right_slide]
  opening: 0.1
  pads: {centre: [0, 0.004, 0.04], half: [0.009, 0.004, 0.01]}
"""


def chain(links: int = 7) -> str:
    """The arm's bodies, nested; masses are those of the shapes."""
    inner = HAND
    for i in reversed(range(links)):
        (x, y, z), axis = LINKS[i]
        inner = f"""<body name="l{i + 1}" pos="{x} {y} {z}">
          <joint name="j{i + 1}" axis="{axis}" range="-2.4 2.4" damping="1" frictionloss="0.3" armature="0.4"/>
          <geom type="capsule" fromto="0 0 0 0 0 0.07" size="0.05" mass="{3.5 - 0.4 * i}"/>{inner}</body>"""
    return f'<body name="foot" pos="1 0 0"><geom type="cylinder" size="0.08 0.05" mass="4"/>{SEEN}{inner}</body>'


def write_arm(folder: Path, sheet: str = SHEET, links: int = 7, more: str = "") -> Path:
    """Write the two files; the MJCF has a floor, a light, servos and a keyframe of its own, too."""
    folder.mkdir(parents=True, exist_ok=True)
    servos = "".join(f'<position joint="j{i + 1}" kp="500"/>' for i in range(links))
    (folder / "assets").mkdir(exist_ok=True)
    (folder / "assets" / "cap.obj").write_text(CAP)
    (folder / "my_arm.xml").write_text(f"""<mujoco><compiler angle="radian" meshdir="assets"/>
      <asset><mesh file="cap.obj"/></asset><worldbody>
      <light pos="0 0 3"/><geom type="plane" size="2 2 0.1"/>{chain(links)}{more}</worldbody>
      <actuator>{servos}</actuator></mujoco>""")
    (folder / "description.yaml").write_text(sheet)
    return folder
