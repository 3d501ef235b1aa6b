"""A pose estimator behind palpate's protocol: a red ball, by its colour and by how large it looks.

palpate see desk.xml --camera desk.png --intrinsics camera.yaml --pose-estimator "python ball_estimator.py"
"""

import base64
import io
import json
import sys

import numpy as np
from PIL import Image

asked = json.load(sys.stdin)
picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(asked["image"]))), dtype=float)
lens = asked["intrinsics"]
k1, k2, p1, p2, k3 = lens["distortion"]

# Rays through the red pixels, without the lens's distortion, in OpenCV's camera frame.
red = picture[..., 0] > 1.6 * picture[..., 1:].max(axis=2) + 10
v, u = np.nonzero(red)
bent = np.stack([(u - lens["cx"]) / lens["fx"], (v - lens["cy"]) / lens["fy"]])
x, y = bent
for _ in range(10):
    r2 = x**2 + y**2
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    x, y = (
        (bent[0] - 2 * p1 * x * y - p2 * (r2 + 2 * x**2)) / radial,
        (bent[1] - p1 * (r2 + 2 * y**2) - 2 * p2 * x * y) / radial,
    )
rays = np.stack([x, y, np.ones_like(x)])
far = np.linalg.norm(rays, axis=0)

found = {}
if len(u) > 50:
    # A ball fills a cone: its axis is the mean ray, its solid angle 2π (1 - cos α), its distance r / sin α.
    angles = 1 / (lens["fx"] * lens["fy"] * far**3)
    axis = (rays / far * angles).sum(axis=1)
    axis /= np.linalg.norm(axis)
    cosine = 1 - angles.sum() / (2 * np.pi)
    for one in asked["objects"]:
        rows = [line.split()[1:] for line in one["mesh"].splitlines() if line.startswith("v ")]
        corners = np.array(rows, dtype=float)
        low, high = corners.min(axis=0), corners.max(axis=0)
        if np.ptp(high - low) > 1e-3:
            continue  # no ball
        distance = (high - low).mean() / 2 / np.sqrt(1 - cosine**2)
        place = distance * axis - (low + high) / 2
        # Across the view 1 mm, along it 1 %; nothing shows how a ball is turned.
        along = (0.01 * distance) ** 2 - 0.001**2
        covariance = np.eye(6) * 9.0
        covariance[:3, :3] = 0.001**2 * np.eye(3) + along * np.outer(axis, axis)
        found[one["name"]] = {
            "pos": place.tolist(),
            "quat": [1.0, 0.0, 0.0, 0.0],
            "covariance": covariance.tolist(),
        }
json.dump({"objects": found}, sys.stdout)
