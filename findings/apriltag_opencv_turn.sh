#!/usr/bin/env bash
# OpenCV draws AprilTags upside down: its pose of a tag differs by half a turn from that of the AprilTag library.
#
# Packages: opencv-contrib-python==5.1.0.95 pupil-apriltags==1.0.4.post11 moms-apriltag==2023.1.15 numpy==2.4.6.
# Expected: a picture of tag 5 of the family 36h11 is the same in every program, up to its margin.
# Happens: OpenCV's picture is the AprilTag project's, turned by 180°. Either program reads the number from either
# picture. But the AprilTag library finds OpenCV's picture turned by 180°, and OpenCV begins the corners of the
# project's picture at the lower right.
# Why it matters: tags that one program printed and the other one measures have the right place and a wrong frame. An
# object is grasped from the wrong side, and nothing warns.
# Source: the pictures of https://github.com/AprilRobotics/apriltag-imgs and OpenCV's DICT_APRILTAG_36h11.
#
# Exit status 0: as described. Another one: the behaviour has changed, or a package is not to be had.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet opencv-contrib-python==5.1.0.95 pupil-apriltags==1.0.4.post11 \
  moms-apriltag==2023.1.15 numpy==2.4.6
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
from importlib.metadata import version

import cv2
import numpy as np
from moms_apriltag import TagGenerator2
from pupil_apriltags import Detector

NUMBER, SIDE = 5, 200
FAMILY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


def on_paper(tag):
    """Show the tag in the middle of a white picture."""
    paper = np.full((600, 800), 255, np.uint8)
    paper[200 : 200 + SIDE, 300 : 300 + SIDE] = cv2.resize(tag, (SIDE, SIDE), interpolation=cv2.INTER_NEAREST)
    return paper


def turn_by_apriltag(picture):
    """Angle in degrees from the tag's x axis to the picture's, by the AprilTag library."""
    (tag,) = Detector(families="tag36h11").detect(picture, True, (500, 500, 400, 300), 0.1)
    assert tag.tag_id == NUMBER
    return round(np.degrees(np.arctan2(tag.pose_R[1, 0], tag.pose_R[0, 0]))) % 360


def turn_by_opencv(picture):
    """The same angle by OpenCV: from its first corner, the upper left, to the second one."""
    (corners,), ids, _ = cv2.aruco.ArucoDetector(FAMILY).detectMarkers(picture)
    assert np.ravel(ids).tolist() == [NUMBER]
    x, y = np.reshape(corners, (4, 2))[1] - np.reshape(corners, (4, 2))[0]
    return round(np.degrees(np.arctan2(y, x))) % 360


by_opencv = cv2.aruco.generateImageMarker(FAMILY, NUMBER, 8)
by_project = TagGenerator2("tag36h11").generate(NUMBER)
print("opencv", cv2.__version__, "pupil-apriltags", version("pupil-apriltags"))
print("OpenCV's picture is the project's, turned by 180 degrees:", np.array_equal(by_opencv, np.rot90(by_project, 2)))
turns = {}
for name, tag in (("OpenCV's picture", by_opencv), ("the project's picture", by_project)):
    turns[name] = (turn_by_opencv(on_paper(tag)), turn_by_apriltag(on_paper(tag)))
    print(f"{name}: turned by {turns[name][0]} degrees for OpenCV, {turns[name][1]} for the AprilTag library")
assert np.array_equal(by_opencv, np.rot90(by_project, 2)) and not np.array_equal(by_opencv, by_project)
assert turns == {"OpenCV's picture": (0, 180), "the project's picture": (180, 0)}
PYTHON
# Output, 2026-11-28:
# opencv 5.1.0 pupil-apriltags 1.0.4.post11
# OpenCV's picture is the project's, turned by 180 degrees: True
# OpenCV's picture: turned by 0 degrees for OpenCV, 180 for the AprilTag library
# the project's picture: turned by 180 degrees for OpenCV, 0 for the AprilTag library
