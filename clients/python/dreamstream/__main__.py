"""`python -m dreamstream run FILE.py:CLASS --connect tcp/HOST:PORT` serves a policy; `doctor FILE.py:CLASS` examines it."""

from __future__ import annotations

import argparse
import importlib.util
import logging
import os
import shutil
import sys
from pathlib import Path
from typing import Optional, Sequence, Type

from .bridge import run
from .policy import Policy


def load(target: str) -> Type[Policy]:
    """Returns the class of `FILE.py:CLASS`."""
    path, _, name = target.rpartition(":")
    if not path or not name:
        raise SystemExit(f"{target!r} is not of the form FILE.py:CLASS")
    file = Path(path)
    if not file.is_file():
        raise SystemExit(f"there is no file {path!r}")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None:
        raise SystemExit(f"{path!r} is not a Python file")
    sys.path.insert(0, str(file.resolve().parent))
    module = importlib.util.module_from_spec(spec)
    sys.modules[file.stem] = module
    spec.loader.exec_module(module)
    found = getattr(module, name, None)
    if not (isinstance(found, type) and issubclass(found, Policy)):
        known = [key for key, value in vars(module).items() if isinstance(value, type) and issubclass(value, Policy)]
        raise SystemExit(f"{path!r} has no policy {name!r}; its policies are {known}")
    return found


def examine(policy: str, *, json: bool) -> int:
    """Has the program `dreamstream` ask the policy, in a process of this Python."""
    beside = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    program = shutil.which("dreamstream", path=beside)
    if program is None:
        raise SystemExit("the program dreamstream is not on the PATH: it draws the states that the policy is asked about")
    load(policy)
    words = [program, "policy", "doctor", policy, "--python", sys.executable, *(["--json"] if json else [])]
    os.execv(program, words)


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m dreamstream", description="Connect a driving policy to DreamStream.")
    commands = parser.add_subparsers(dest="command", required=True)
    serve = commands.add_parser("run", help="serve a policy until interrupted")
    serve.add_argument("policy", metavar="FILE.py:CLASS", help="a subclass of dreamstream.Policy")
    serve.add_argument("--connect", default="tcp/127.0.0.1:7448", help="the bridge's address (default %(default)s)")
    serve.add_argument("--name", default="guest", help="the policy's name on the bus (default %(default)s)")
    serve.add_argument("--sessions", type=int, default=None, help="end after this many sessions")
    serve.add_argument("--wait", type=float, default=120.0, help="seconds to wait for the bridge (default %(default)s)")
    serve.add_argument("--config", default=None, help="a Zenoh configuration file, for certificates")
    serve.add_argument("--quiet", action="store_true", help="say only what goes wrong")
    doctor = commands.add_parser("doctor", help="name what is wrong with how a policy is wrapped: axes, units, rate, origin, state")
    doctor.add_argument("policy", metavar="FILE.py:CLASS", help="a subclass of dreamstream.Policy")
    doctor.add_argument("--json", action="store_true", help="print JSON")
    given = parser.parse_args(arguments)
    if given.command == "doctor":
        return examine(given.policy, json=given.json)
    logging.basicConfig(level=logging.WARNING if given.quiet else logging.INFO, format="%(levelname)s %(message)s")
    try:
        run(
            load(given.policy),
            connect=given.connect,
            name=given.name,
            sessions=given.sessions,
            wait_s=given.wait,
            config_file=given.config,
        )
    except KeyboardInterrupt:
        return 130
    except ConnectionError as error:
        logging.error("%s", error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
