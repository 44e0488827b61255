"""`jaxgeo`: the commands, and what an error looks like to a user.

Commands import what they need when they run: `jaxgeo --help` should not wait for JAX.
"""

import contextlib
import signal
import sys
import threading
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from jaxgeo.cli.campaign_command import campaign
from jaxgeo.cli.check_command import check
from jaxgeo.cli.compare_command import compare
from jaxgeo.cli.map_command import map_
from jaxgeo.cli.odometry_command import odometry
from jaxgeo.cli.place_command import place, predict
from jaxgeo.cli.replay_command import replay
from jaxgeo.cli.rtabmap_command import rtabmap
from jaxgeo.cli.simulate_sensors_command import simulate_sensors
from jaxgeo.cli.study_commands import study
from jaxgeo.cli.warp_command import warp
from jaxgeo.errors import JaxgeoError

INTERNAL_ERROR = 1
BAD_INPUT = 2
INTERRUPTED = 130
TERMINATED = 143
# A signal that came while an object was being removed, where Python drops exceptions, comes again after so long.
_AGAIN_S = 0.05

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
app.add_typer(study, name="study")


@app.callback()
def _root(debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks.")] = False) -> None:
    """Georeference a drifting trajectory with a few surveyed markers.

    Exit codes: 0 done; 2 bad input or config; 3 the estimate did not converge or is not determined.
    """


@app.command()
def run(
    config: Annotated[Path, typer.Argument(help="The session's config (YAML).")],
    out: Annotated[Path | None, typer.Option(help="Folder for the outputs; default out/NAME.")] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Replace one value of the config: coarse.scale=false"),
    ] = None,
    dump_config: Annotated[
        bool, typer.Option("--dump-config", help="Print the whole config, defaults written out, and stop.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Georeference the trajectories of one session."""
    from jaxgeo.cli.run import print_config, run_config

    if dump_config:
        print_config(config, set_ or [])
    else:
        run_config(config, out, set_ or [], quiet)


@app.command()
def detect(
    source: Annotated[
        Path,
        typer.Argument(
            help="A session's config (YAML) with sightings of kind images; or images: a folder, a video, a ROS bag."
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the outputs; with a config default out/NAME/detections.")
    ] = None,
    family: Annotated[
        list[str] | None, typer.Option(help="Family of markers, may be repeated; default apriltag_36h11.")
    ] = None,
    decoder: Annotated[
        str | None, typer.Option(help="What finds printed markers: opencv (default), kornia or both.")
    ] = None,
    hsv: Annotated[
        str | None,
        typer.Option(
            metavar="H,S,V,H,S,V", help="Look inside this colour range only (iMarkers), or: green, red, blue."
        ),
    ] = None,
    polarity: Annotated[
        str | None,
        typer.Option(help="What has the colour: marker (the dark cells), ground (the light ones) or auto."),
    ] = None,
    rig: Annotated[Path | None, typer.Option(help="The cameras (YAML): needed for poses.")] = None,
    size: Annotated[float | None, typer.Option(metavar="M", help="Side of the markers: needed for poses.")] = None,
    stamps: Annotated[Path | None, typer.Option(help="Table of stamps and files of a folder's images.")] = None,
    rate: Annotated[float | None, typer.Option(metavar="HZ", help="Images a second, where none has a stamp.")] = None,
    start: Annotated[float | None, typer.Option(metavar="S", help="Stamp of the first image.")] = None,
    camera: Annotated[str | None, typer.Option(help="The rig's camera that took the images.")] = None,
    topic: Annotated[list[str] | None, typer.Option(metavar="TOPIC=CAMERA", help="Of a bag; may be repeated.")] = None,
    workers: Annotated[int | None, typer.Option(min=1, max=256, help="Processes that detect.")] = None,
    overlays: Annotated[str | None, typer.Option(help="Pictures of detections, at most; or all. Default 12.")] = None,
    tune: Annotated[
        bool, typer.Option("--tune", help="Fit the colour range to a folder of labelled images, and stop.")
    ] = False,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Replace one value of the config.")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Find markers in images: corners, poses, pictures. Killed and started again, it goes on where it was."""
    if tune:
        from jaxgeo.cli.tune import tune_folder

        tune_folder(source, out, hsv, quiet)
        return
    from jaxgeo.cli.detect import DetectOptions, detect_images

    options = DetectOptions(
        family=family or (),
        decoder=decoder,
        hsv=hsv,
        polarity=polarity,
        rig=rig,
        size_m=size,
        stamps=stamps,
        rate_hz=rate,
        start_s=start,
        camera=camera,
        topic=topic or (),
        workers=workers,
        overlays=overlays,
    )
    detect_images(source, out, options, set_ or [], quiet)


@app.command()
def calibrate(
    config: Annotated[Path, typer.Argument(help="The session's config (YAML).")],
    out: Annotated[Path | None, typer.Option(help="Folder for the outputs; default out/NAME.")] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Replace one value of the config: noise.observations=revisit"),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Learn the odometry noise of one session, without correcting anything: noise.json and calibration.html."""
    from jaxgeo.cli.calibrate import calibrate_config

    calibrate_config(config, out, set_ or [], quiet)


@app.command()
def evaluate(
    configs: Annotated[list[Path], typer.Argument(help="The sessions' configs (YAML), one or several.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the outputs; default out/NAME, of several sessions out/evaluate.")
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Replace one value of every config: evaluate.subsets=20"),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Judge sessions by what is held out: every table and figure of the study, for one's own recordings."""
    from jaxgeo.cli.evaluate import evaluate_configs

    evaluate_configs(configs, out, set_ or [], quiet)


@app.command()
def simulate(
    out: Annotated[Path, typer.Option(help="Folder for the session's files; with --session both, for two folders.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")] = 0,
    session: Annotated[str, typer.Option(help="The reference study's layout: uav, ugv or both.")] = "uav",
    drift: Annotated[
        str, typer.Option(help="What is wrong with it: paper, white, biased, gauss-markov, heavy-tailed or scale.")
    ] = "paper",
    swap_visits: Annotated[
        list[str] | None, typer.Option(metavar="I,J", help="Exchange two visits in the visiting order, from 1.")
    ] = None,
    swap_locations: Annotated[
        list[str] | None, typer.Option(metavar="B,E", help="Exchange two locations in the survey.")
    ] = None,
    shift: Annotated[
        list[str] | None, typer.Option(metavar="C=E,N,H", help="Shift a location in the survey, metres.")
    ] = None,
    label: Annotated[
        list[str] | None, typer.Option(metavar="I=D", help="Give a visit another location's name.")
    ] = None,
    time_offset: Annotated[float, typer.Option(metavar="S", help="Make the sightings' stamps late by this.")] = 0.0,
) -> None:
    """Write a simulated session with known truth: its files, and the config that runs on them."""
    from jaxgeo.cli.simulate import faults_of, simulate_files

    faults = faults_of(swap_visits or [], swap_locations or [], shift or [], label or [], time_offset)
    for config in simulate_files(out, seed, session, drift, faults):
        typer.echo(config)


@app.command()
def demo(
    out: Annotated[
        Path, typer.Option(help="Folder for the outputs; the simulated inputs go to its folder 'session'.")
    ] = Path("out/demo"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")] = 0,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Simulate a session, then georeference it."""
    from jaxgeo.cli.run import run_config
    from jaxgeo.simulate import simulate_session, write_session_files

    run_config(write_session_files(simulate_session(seed), out / "session"), out, [], quiet)


@app.command(name="marker-map")
def marker_map(
    corners: Annotated[Path, typer.Argument(help="Marker corners (CSV), as jaxgeo detect writes them.")],
    rig: Annotated[Path, typer.Option(help="The cameras (YAML).")],
    size: Annotated[float, typer.Option(metavar="M", help="Side of the markers.")],
    out: Annotated[Path, typer.Option(help="Folder for the outputs.")] = Path("out/marker_map"),
    origin: Annotated[str | None, typer.Option(help="The marker that is the frame; default: the most seen.")] = None,
    only: Annotated[str | None, typer.Option(metavar="ID,ID,..", help="Map these markers only.")] = None,
    refine_camera: Annotated[
        bool, typer.Option("--refine-camera", help="Estimate focal scale, principal point, k1 and k2 too.")
    ] = False,
    pixel_sigma: Annotated[float, typer.Option(metavar="PX", help="Sigma of corners without a column sigma_px.")] = 0.3,
    floor: Annotated[
        float, typer.Option(metavar="PX", min=0.0, help="Added in quadrature to every corner's sigma: lens, print.")
    ] = 0.1,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
) -> None:
    """Map markers from photographs alone: poses of all markers and images, without survey or odometry."""
    from jaxgeo.cli.marker_map import map_markers
    from jaxgeo.solve.marker_map import MapSettings

    settings = MapSettings(floor_px=floor, refine_camera=refine_camera, origin=origin)
    chosen = [] if only is None else [name.strip() for name in only.split(",")]
    map_markers(corners, rig, size, out, settings, pixel_sigma_px=pixel_sigma, only=chosen, quiet=quiet)


for name, command in {
    "odometry": odometry,
    "map": map_,
    "warp": warp,
    "place": place,
    "predict": predict,
    "campaign": campaign,
    "check": check,
    "replay": replay,
    "compare": compare,
    "rtabmap": rtabmap,
    "simulate-sensors": simulate_sensors,
}.items():
    app.command(name=name)(command)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command line and return its exit code; errors are one message on stderr."""
    command = typer.main.get_command(app)
    debug = False
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with _stoppable(), command.make_context("jaxgeo", given) as context:
            debug = context.params["debug"]
            command.invoke(context)
    except typer.Exit as stop:
        return stop.exit_code
    except typer.TyperException as error:
        return _fail(f"{error.format_message()}\nTry 'jaxgeo --help'.", BAD_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        return _fail("interrupted", INTERRUPTED)
    except _Terminated:
        return _fail("terminated", TERMINATED)
    except JaxgeoError as error:
        return _fail(str(error), error.exit_code, debug)
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        return _fail(f"{place}{error.strerror or error}", BAD_INPUT, debug)
    except Exception as error:
        what = f"{type(error).__name__}: {error}"
        return _fail(
            f"{what}\nThis is a fault of jaxgeo. Please report it, with what --debug shows.", INTERNAL_ERROR, debug
        )
    return 0


class _Terminated(BaseException):
    """SIGTERM came: unwind, so that every temporary file is removed, and go."""


@contextlib.contextmanager
def _stoppable() -> Iterator[None]:
    """Turn SIGTERM into an exception, as Python does with SIGINT; where none can be raised, a little later."""
    if threading.current_thread() is not threading.main_thread():  # only there can signals be caught
        yield
        return

    def stop(*_: object) -> None:
        raise _Terminated

    def again(unraisable: Any) -> None:
        number = {KeyboardInterrupt: signal.SIGINT, _Terminated: signal.SIGTERM}.get(unraisable.exc_type)
        if number is None:
            kept_hook(unraisable)
            return
        later = threading.Timer(_AGAIN_S, signal.pthread_kill, (threading.main_thread().ident, number))
        later.daemon = True
        later.start()

    kept, kept_hook = signal.signal(signal.SIGTERM, stop), sys.unraisablehook
    sys.unraisablehook = again
    try:
        yield
    finally:
        sys.unraisablehook = kept_hook
        signal.signal(signal.SIGTERM, kept)


def _fail(message: str, code: int, debug: bool = False) -> int:
    if debug:
        traceback.print_exc()
    print(f"error: {message}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
