"""`python -m tests.fci FD SETUP`: serve what the JSON describes; the side door is the socket FD."""

from __future__ import annotations

import json
import os
import socket
import sys
from contextlib import suppress

from .bench import Setup, Workbench
from .door import Door

PRIORITY = -10
"""Nice value: a client gives up after 1 s without a state, however busy the machine is."""

if __name__ == "__main__":
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, PRIORITY)
    line = socket.socket(fileno=int(sys.argv[1]))
    bench = Workbench(Setup(**json.loads(sys.argv[2])))
    door = Door(bench, line)
    bench.server.open_door(line, door.visit)
    line.sendall(b"true\n")
    bench.server.serve()
