"""`python -m tests.fci FD SETUP`: serve what the JSON describes; the side door is the socket FD."""

from __future__ import annotations

import json
import socket
import sys

from .bench import Setup, Workbench
from .door import Door

if __name__ == "__main__":
    line = socket.socket(fileno=int(sys.argv[1]))
    bench = Workbench(Setup(**json.loads(sys.argv[2])))
    door = Door(bench, line)
    bench.server.open_door(line, door.visit)
    line.sendall(b"true\n")
    bench.server.serve()
