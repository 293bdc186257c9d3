"""Make a Debian root with Gazebo 11 and our server in it: `python benchmarks/gazebo/root.py`.

Gazebo 11 is part of Debian's suite "bullseye". The root has 2.7 GB, takes 10 minutes, and needs the user root and
`debootstrap`. It is made in $EQUIPOISE_GAZEBO_ROOT, or in the user's cache folder, outside the repository.
"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

SERVER = "/opt/server"
"""Path of the server in the root."""
_SOURCE = Path(__file__).with_name("server.cc")
_PACKAGES = ("gazebo", "libgazebo-dev", "g++")
_CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
ROOT = Path(os.environ.get("EQUIPOISE_GAZEBO_ROOT", _CACHE / "equipoise" / "gazebo"))


def inside(*command: str) -> list[str]:
    """Return a command that runs in the root; every Gazebo instance gets a port of its own."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    master = f"GAZEBO_MASTER_URI=http://127.0.0.1:{port}"
    return [
        "chroot",
        str(ROOT),
        "env",
        "HOME=/tmp",
        "OMP_NUM_THREADS=1",
        "GAZEBO_MODEL_DATABASE_URI=",
        master,
        *command,
    ]


def prepare_root() -> Path:
    """Make the root, unless it exists, and compile the server, unless it is compiled.

    Raises:
        SystemExit: the user is not root, or `debootstrap` is not installed, with status 0; the folder is another.
    """
    if os.geteuid() != 0:
        _skip("debootstrap and chroot need the user root; run it as root, for example in a container")
    if not (ROOT / "usr/include/gazebo-11").exists():
        if shutil.which("debootstrap") is None:
            _skip("debootstrap is not installed; apt-get install debootstrap")
        if ROOT.exists():
            raise SystemExit(
                f"{ROOT} exists and has no Gazebo: remove it, or set EQUIPOISE_GAZEBO_ROOT to another folder"
            )
        unfinished = ROOT.with_name(f"{ROOT.name}.unfinished")
        print(f"making {ROOT}: 2.7 GB, 10 minutes", flush=True)
        shutil.rmtree(unfinished, ignore_errors=True)
        unfinished.parent.mkdir(parents=True, exist_ok=True)
        subprocess.run(["debootstrap", "--variant=minbase", "bullseye", unfinished], check=True)
        environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
        install = ["apt-get", "install", "--yes", "--no-install-recommends", *_PACKAGES]
        subprocess.run(["chroot", unfinished, *install], check=True, env=environment)
        unfinished.rename(ROOT)
    server = ROOT / SERVER[1:]
    if not server.exists() or server.with_suffix(".cc").read_bytes() != _SOURCE.read_bytes():
        server.unlink(missing_ok=True)
        shutil.copy(_SOURCE, server.with_suffix(".cc"))
        flags = "-std=c++17 -O2 -DBOOST_BIND_GLOBAL_PLACEHOLDERS $(pkg-config --cflags --libs gazebo)"
        subprocess.run(["chroot", ROOT, "sh", "-c", f"g++ {SERVER}.cc -o {SERVER} {flags}"], check=True)
    return ROOT


def _skip(reason: str) -> NoReturn:
    print(f"skipped: {reason}", file=sys.stderr)
    raise SystemExit(0)


if __name__ == "__main__":
    print(prepare_root())
