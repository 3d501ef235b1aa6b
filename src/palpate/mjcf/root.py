"""Root folder of a scene: the nearest common folder of the scene and all files that it refers to.

A scene file is untrusted, and could name any file of its reader's. Its own folder may be read, and
folders beside it; one that also holds what is no scene's (a whole home, a folder of the system, a file
system's root) must be named by the user.
"""

from __future__ import annotations

import os
from pathlib import Path

HOMES = ("/home", "/Users")
"""Folders of homes: each folder in them is a whole home."""
SYSTEM = (
    *("/bin", "/boot", "/dev", "/etc", "/lib", "/lib64", "/media", "/mnt", "/opt", "/private"),
    *("/proc", "/root", "/run", "/sbin", "/srv", "/sys", "/tmp", "/usr", "/var", "/var/tmp"),
    *("/Applications", "/Library", "/System", "/Volumes"),
)
"""Folders of the system, of Linux and macOS; of `/usr` and `/var` also each folder in them."""


def common(folder: Path, path: Path) -> Path:
    """Nearest folder that holds both; both resolved."""
    return Path(os.path.commonpath([folder, path.parent]))


def is_too_wide(root: Path) -> bool:
    """True for a whole home, a folder of the system, or a file system's root, which are read only when
    the user names them."""
    own = Path.home().resolve()
    if root == root.parent or root in (own, *own.parents):
        return True
    name, above = root.as_posix(), root.parent.as_posix()
    return name in (*SYSTEM, *HOMES) or above in (*HOMES, "/usr", "/var", "/private")
