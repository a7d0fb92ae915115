#!/usr/bin/env python3
"""Prints what a run sends as Open Sound Control.

    pip install -r examples/python/requirements.txt
    python3 examples/python/osc_print.py --port 9000 &
    hulltouch demo --osc 127.0.0.1:9000
"""

import argparse

from pythonosc.dispatcher import Dispatcher
from pythonosc.osc_server import BlockingOSCUDPServer


class Printer:
    """Prints messages until there were enough."""

    def __init__(self, enough):
        self.left = enough

    def __call__(self, address, *values):
        if self.left == 0:
            return
        self.left -= 1
        shown = " ".join(f"{value:.3f}" if isinstance(value, float) else str(value) for value in values)
        print(f"{address} {shown}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--host", default="127.0.0.1", help="the address to listen on [%(default)s]")
    parser.add_argument("--port", type=int, default=9000, help="0: any free one, which is printed [%(default)s]")
    parser.add_argument("--messages", type=int, default=-1, help="end after so many [never]")
    arguments = parser.parse_args()
    printer = Printer(arguments.messages)
    dispatcher = Dispatcher()
    dispatcher.map("/hulltouch/*", printer)
    with BlockingOSCUDPServer((arguments.host, arguments.port), dispatcher) as server:
        print(f"listening on port {server.server_address[1]}", flush=True)
        while printer.left != 0:
            server.handle_request()


if __name__ == "__main__":
    main()
