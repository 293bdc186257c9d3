"""`equipoise export`."""

from __future__ import annotations

import dataclasses
import json as json_module
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from equipoise.calibration.run_header import HEADER, RESULT, read_header
from equipoise.cli.flags import File, Flag, Output
from equipoise.errors import OutputError, SettingsError
from equipoise.user_file import made_folder, typed

if TYPE_CHECKING:
    from equipoise.exports.formats import Export
    from equipoise.result.calibration import Calibration
    from equipoise.robot.model import RobotModel

_FOLDER = "export"
_PARAMETERS = (
    "'base' (mass, centre of mass, inertia), 'sensors' (joint offsets, IMU, clock), 'motors' (friction, armature, gain, "
    "delay), 'legs' (masses and first moments of their links; with the base in a model file), several with commas, or 'all' "
    "that the format holds. Default: base, or all if the format or the run lacks the base."
)
Run = Annotated[
    Positional[Path | None],
    arg(metavar="RUN", help="Run folder of a calibration, or a result as JSON.", help_behavior_hint=""),
]


def export(
    run: Run = None,
    *,
    to: Annotated[str | None, arg(metavar="FORMAT", help_behavior_hint="")] = None,
    all: Flag = False,
    parameters: Annotated[str | None, arg(metavar="NAMES", help=_PARAMETERS, help_behavior_hint="")] = None,
    out: File = None,
    file: File = None,
    force: Flag = False,
    add_payload_link: Flag = False,
    samples: int = 0,
    seed: int = 0,
    relative_to: Annotated[str | None, arg(metavar="MODEL", help_behavior_hint="")] = None,
    list: Flag = False,
    output: Output,
) -> None:
    """Write a result into the file that a controller or simulator reads. Without --to,
    list the formats.

    urdf and mjcf copy the run's model file and change only the inertial of the base
    link. Other --parameters, and results of another name, are written to separate
    files, such as a1_motors.urdf. Every file states its body, frame, stance and run.
    Parameters that are not identified are not written, unless you pass --force.

    Example: equipoise export runs/go2 --to urdf
             equipoise export runs/go2 --to xacro --file const.xacro --out const.xacro
             equipoise export runs/go2 --all --parameters all --out numbers
             equipoise export runs/go2 --relative-to go2.xml

    Args:
        to: Format; --list shows all.
        all: Write all formats that can hold the parameters into the folder --out, and list the others with the reason; exits
            with 0 if one is written.
        out: File to write, in an existing folder; default export/ in the run folder. To overwrite your own file, name it here.
        file: Your file to edit: for urdf and mjcf instead of the run's model file; sdf and xacro write a new file without it.
        force: Also write doubtful parameters and those that are not identified, or the valid body nearest to the payload.
        add_payload_link: Leave the base link unchanged and write the payload as the fixed link equipoise_payload.
        samples: For mjlab and isaaclab: number of sampled bodies to list.
        seed: Seed of the samples.
        relative_to: Model that a policy was trained on: write the base's difference from it, as json and ros2 or --to one.
        list: List the formats; with RUN, the parameters of that run in each, and the reasons why others cannot be written.
    """
    if run is not None and not run.is_file():
        read_header(run)
    if run is None or list or not (all or to or relative_to is not None):
        if (all or to or relative_to is not None) and not list:
            flags = f"--to {to}" if to else "--all" if all else f"--relative-to {relative_to}"
            raise SettingsError(f"no run is given: equipoise export RUN {flags}")
        _show_formats(run, force, output.json)
        if run is not None and not list:
            print(
                f"nothing was written; name a format, for example: equipoise export {typed(run)} --to urdf",
                file=sys.stderr,
            )
        return
    if all or to is None:
        if to or file or add_payload_link or samples:
            flag = "--all writes every format" if all else "--relative-to writes several files"
            raise SettingsError(f"{flag}; leave out --to, --file, --add-payload-link and --samples")
        if all and relative_to is not None:
            raise SettingsError("--relative-to writes json and ros2, not --all formats; leave out --all")
        _export_all(run, out, force, seed, parameters, relative_to, output)
        return
    from equipoise.exports import formats
    from equipoise.terminal.export_listing import print_export

    formats.find_format(to)
    result = _result(run)
    written = formats.export(
        result,
        to,
        file=file,
        payload_link=add_payload_link,
        force=force,
        samples=samples,
        seed=seed,
        run=str(run),
        parameters=parameters,
        relative_to=_reference(relative_to, result),
    )
    path = written.save(out or _default_path(run, written, file))
    table = {"schema": "equipoise.export/1", "path": str(path), "run": str(run), **written.to_dict()}
    output.write(table, lambda: None if output.quiet else print_export(written, path))


def _export_all(
    run: Path, out: Path | None, force: bool, seed: int, parameters: str | None, relative_to: str | None, output: Output
) -> None:
    from equipoise.exports.formats import Export, export_all
    from equipoise.terminal.export_listing import print_exports

    result = _result(run)
    reference = _reference(relative_to, result)
    exports = export_all(result, force=force, seed=seed, run=str(run), parameters=parameters, relative_to=reference)
    written = {name: one for name, one in exports.items() if isinstance(one, Export)}
    refused = {name: one for name, one in exports.items() if not isinstance(one, Export)}
    if not written:
        raise next(iter(refused.values()))
    folder = made_folder(out or _folder(run))
    paths = {name: one.save(folder / _file_name(run, one)) for name, one in written.items()}
    files = {name: {"path": str(paths[name]), **one.to_dict()} for name, one in written.items()}
    left_out = {name: str(error) for name, error in refused.items()}
    table = {"schema": "equipoise.exports/1", "files": files, "left_out": left_out}
    output.write(
        table, lambda: None if output.quiet else print_exports(written, paths, refused, relative_to is not None)
    )


def _reference(name: str | None, result: Calibration) -> RobotModel | None:
    if name is None:
        return None
    from equipoise.exports.relative import load_reference

    return load_reference(name, result)


def _folder(run: Path) -> Path:
    return (run.parent if run.is_file() else run) / _FOLDER


def _file_name(run: Path, written: Export) -> str:
    """Return the name of an export; the stem of a result file is appended, so that results of one run do not collide."""
    name = Path(written.file_name)
    return name.with_stem(f"{name.stem}_{run.stem}").name if run.is_file() and run.name != RESULT else name.name


def _show_formats(run: Path | None, force: bool, json: bool) -> None:
    from equipoise.exports.formats import Export, Format, all_formats, export_all
    from equipoise.terminal.export_listing import print_formats

    formats = all_formats()
    of_run = {} if run is None else export_all(_result(run), force=force, run=str(run), parameters="all")
    if not json:
        print_formats(formats, of_run)
        return
    found = {name: {"of_run": one.parts} if isinstance(one, Export) else {"not_written": str(one)}
             for name, one in of_run.items()}  # fmt: skip
    rows = [
        {"name": row.name, "bodies": row.bodies, "lacks": row.lacks, "parts": row.parts, "where": row.where, "file": row.file,
         "payload_link": row.payload,
         "page": row.page if "/" in row.page or not row.page else f"docs/reference/exports.md#{row.page}",
         **found.get(name, {})}
        if isinstance(row, Format) else {"name": name, "cannot_be_used": str(row)}
        for name, row in formats.items()
    ]  # fmt: skip
    print(json_module.dumps({"schema": "equipoise.formats/1", "formats": rows}, indent=2))


def _result(run: Path) -> Calibration:
    """Return the result of a run folder or JSON file, with the robot model of its run if that is in the same folder."""
    from equipoise.calibration.run_folder import RunFolder
    from equipoise.result.calibration import Calibration

    if not run.is_file():
        return RunFolder.open(run).result()
    result = Calibration.load(run)
    model = RunFolder.open(run.parent).robot() if (run.parent / HEADER).exists() else None
    if model is None or model.source.sha256 != result.model["sha256"]:
        return result
    return dataclasses.replace(result, robot_model=model)


def _default_path(run: Path, written: Export, file: Path | None) -> Path:
    """Return the path for an export without --out; raises OutputError if that is the file to edit."""
    path = made_folder(_folder(run)) / _file_name(run, written)
    if file is not None and path.exists() and path.samefile(file):
        raise OutputError(f"{str(path)!r} is the file to edit; to overwrite it, pass it to --out too")
    return path
