"""Pythons with a version of cyclonedds that robots run, in environments of their own; all else is what is installed here."""

import os
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

SOURCES = {  # sdists: there are no wheels for the Pythons that have version 11
    "0.10.2": "f834962eabbdcdf4e9cd75cf87222f3c5ef22d9cb9e7ed651d9a8710fe984a30",
    "0.10.5": "63fc4d6fdb2fd35181c40f4e90757149f2def5f570ef19fb71edc4f568755f8a",
}
PATIENCE = 120.0  # [s] for pip
_INCLUDES = ("/usr/include", "/usr/local/include")
_LIBRARIES = (f"/usr/lib/{sysconfig.get_config_var('MULTIARCH')}", "/usr/lib64", "/usr/lib", "/usr/local/lib")


class CannotBuildError(Exception):
    """Why there is no such Python here."""


def older_python(version, folder):
    """The Python of an environment in a folder, made by the first of the processes that ask; raises CannotBuildError."""
    outcome = folder / "outcome"
    try:
        folder.mkdir()
    except FileExistsError:
        _wait_for(outcome)
    else:
        outcome.with_suffix(".new").write_text(_why_not(version, folder / "venv"), encoding="utf-8")
        outcome.with_suffix(".new").rename(outcome)
    if why := outcome.read_text(encoding="utf-8"):
        raise CannotBuildError(why)
    return str(folder / "venv" / "bin" / "python")


def _wait_for(path):
    until = time.monotonic() + 3 * PATIENCE
    while not path.exists():
        if time.monotonic() > until:
            raise CannotBuildError(f"{path.parent} was begun by another process and is not there")
        time.sleep(0.1)


def _why_not(version, folder):
    """Make it; why that cannot be done, or nothing."""
    try:
        _make(version, folder)
    except CannotBuildError as error:
        return str(error)
    return ""


def _make(version, folder):
    if sys.version_info < (3, 11):
        raise CannotBuildError("this Python has 0.10 itself")
    home = os.environ.get("CYCLONEDDS_HOME") or str(_home(folder / "home"))
    python = folder / "bin" / "python"
    _run([sys.executable, "-m", "venv", "--without-pip", str(folder)], os.environ)  # this one's pip will do
    wanted = folder / "cyclonedds.txt"
    wanted.write_text(f"cyclonedds=={version} --hash=sha256:{SOURCES[version]}\n", encoding="utf-8")
    pip = [sys.executable, "-m", "pip", "--python", str(python), "--quiet", "--disable-pip-version-check", "install"]
    options = ["--no-deps", "--require-hashes", "--no-cache-dir", "-r", str(wanted)]
    _run([*pip, *options], {**os.environ, "CYCLONEDDS_HOME": home})
    _add_what_is_installed(python)
    _run([str(python), "-c", "import cyclonedds.core"], os.environ)  # on Python 3.13 it builds, and cannot be imported


def _home(folder):
    """A folder such as cyclonedds builds against, made of the system's, whose libraries may lie deeper."""
    include = next((Path(path) for path in _INCLUDES if (Path(path) / "dds" / "version.h").exists()), None)
    library = next((Path(path) for path in _LIBRARIES if (Path(path) / "libddsc.so").exists()), None)
    if include is None or library is None:
        raise CannotBuildError("libddsc and its headers are not there (Debian, Ubuntu: apt-get install cyclonedds-dev)")
    if '"0.10.' not in (include / "dds" / "version.h").read_text(encoding="utf-8"):
        raise CannotBuildError(f"the libddsc in {library} is not 0.10")
    folder.mkdir(parents=True)
    for name, path in (("include", include), ("lib", library), ("bin", Path("/usr/bin"))):
        (folder / name).symlink_to(path)
    return folder


def _add_what_is_installed(python):
    """Behind the environment's own packages, so that its cyclonedds wins."""
    own = _run([str(python), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"], os.environ)
    here = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    lines = [f"import site; site.addsitedir({path!r})\n" for path in sorted(here)]
    (Path(own.strip()) / "zz_installed.pth").write_text("".join(lines), encoding="utf-8")


def _run(command, environment):
    """What a command prints."""
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=PATIENCE, env={**environment}
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise CannotBuildError(str(error)) from error
    if done.returncode != 0:
        lines = [line.strip() for line in (done.stderr or done.stdout).splitlines() if line.strip()] or [
            "without a word"
        ]
        why = [line for line in lines if line.startswith(("Could not", "ERROR:", "ImportError", "OSError"))] or lines[
            -1:
        ]
        raise CannotBuildError(f"{' '.join(command[1:4])}: {why[0]}")
    return done.stdout
