"""First answers of a live model behind an OpenAI-compatible server on this computer.

`python -m bench.live_model URL MODEL [--feedback N]` asks for ten plans, in text and with decoding by the
JSON schema (`--native`). It counts the plans that pass the check after at most N rounds of findings.
Nothing moves: a plan that fails the check cannot be executed.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

SCENE = """<mujoco><worldbody><site name="robot_base"/>
  <body name="table" pos=".5 0 .1"><geom type="box" size=".3 .4 .1"/></body>
  <body name="bottle" pos=".5 0 .25"><freejoint/>
    <geom type="cylinder" size=".03 .05" mass="?" friction="? .005 .0001"/></body>
  <body name="box" pos=".5 .2 .23"><freejoint/><geom type="box" size=".03 .03 .03" mass="?"/></body>
</worldbody></mujoco>"""
REQUESTS = (
    "What does the bottle weigh?",
    "How heavy is the box?",
    "We don't know the mass of the bottle.",
    "Measure the friction of the bottle.",
    "Weigh the box and the bottle.",
    "I need the mass of the box for a simulation.",
    "How slippery is the bottle on the table?",
    "Find every missing parameter.",
    "Determine the weight of the bottle, please.",
    "Is the box heavier than the bottle?",
)


def is_valid(request: str, scene: Path, url: str, options: list[str]) -> bool:
    """Ask for a plan; true if one passed the check."""
    command = [sys.executable, "-m", "palpate", "plan", "-r", request, "--scene", str(scene)]
    command += ["--prompt", "lean", "--without", "image", "--budget-seconds", "300", *options]
    environment = {**os.environ, "OPENAI_COMPATIBLE_BASE_URL": url}
    made = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    lines = [line for line in made.stderr.splitlines() if line.strip()]
    print(made.returncode, request, lines[-1][:100] if lines else "", file=sys.stderr, flush=True)
    return made.returncode == 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("url", help="up to and including /v1")
    parser.add_argument("model")
    parser.add_argument("--feedback", default="0", help="rounds of findings")
    given = parser.parse_args()
    asked = ["--planner", f"compatible:{given.model}", "--feedback", given.feedback]
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.xml"
        scene.write_text(SCENE)
        for name, options in (("text", []), ("schema", ["--native"])):
            valid = sum(is_valid(one, scene, given.url, asked + options) for one in REQUESTS)
            print(f"{name}: {valid} of {len(REQUESTS)} plans pass the check", flush=True)


if __name__ == "__main__":
    main()
