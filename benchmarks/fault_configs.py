"""Configs that were made to do harm, or by mistake: bombs, tags, names that lead elsewhere, noise tampered with."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks import fault_inputs as inputs
from benchmarks.fault_case import RUN_LIMIT_S, Case, Change, nothing
from benchmarks.fault_files import QUIET, RUN_RESULTS, restored
from benchmarks.fault_places import LIMIT_BYTES

_BOMB = "\n".join(
    ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    + [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
)
# Put before the sound config, or in its place where it ends with a line of dots.
_TEXTS = {
    "aliases": ("'billion laughs': twelve levels of ten aliases", _BOMB, ("alias",)),
    "nesting": ("100 000 brackets within each other", "a: " + "[" * 100_000, ("nested too deeply",)),
    "indents": ("5 000 mappings within each other", "\n".join(" " * i + "a:" for i in range(1000)), ("poses.yaml",)),
    "digits": ("a number of 100 000 digits", "seed: " + "9" * 100_000, ("100000 digits",)),
    "text": ("a text of 2 MB", "name: " + "n" * (2 << 20), ("poses.yaml", "expected at most")),
    "twice": ("a key twice", "seed: 1\nseed: 2", ("'seed' stands twice",)),
    "tag": ("!!python/object/apply:os.system", "seed: !!python/object/apply:os.system ['touch owned']", ("tag",)),
    "merge": ("a merge of itself", "a: &a {<<: *a}", ("poses.yaml",)),
    "control": ("control characters", "seed: \x00\x07", ("poses.yaml",)),
    "not UTF-8": ("bytes that are no text", "name: \udcff\udcfe", ("UTF-8",)),
    "two documents": ("a second document", "seed: 1\n---\nseed: 2\n---", ("poses.yaml",)),
}
# Values of --set; what the message must name.
_SETS = {
    "name ../x": ("name=../x", ("name", "../x")),
    "name /elsewhere/x": ("name=/elsewhere/x", ("name", "/elsewhere/x")),
    "name a/b": ("name=a/b", ("name",)),
    "name ~": ("name='~'", ("name",)),
    "name with a line feed": ('name="a\\nb"', ("name",)),
    "name with a zero byte": ('name="a\\0b"', ("name",)),
    "name ..": ("name='..'", ("name",)),
    "name of 300 letters": (f"name={'n' * 300}", ("name",)),
    "trajectory ../x": (
        "trajectories={'../x': {file: icp.tum, format: tum, odometry: lidar}}",
        ("trajectories", "../x"),
    ),
    "file ../icp.tum": ("trajectories.icp.file=../nowhere/icp.tum", ("nowhere/icp.tum",)),
    "file ~/icp.tum": ("trajectories.icp.file=~/icp.tum", ("icp.tum",)),
    "file with a zero byte": ('trajectories.icp.file="a\\0b"', ("trajectories.icp.file",)),
    "file of 5000 letters": (f"trajectories.icp.file={'f' * 5000}", ("File name too long",)),
    "file ${HOME}": ("trajectories.icp.file='${HOME}/x'", ("${HOME}",)),
    "seed 1e400": ("seed=1e400", ("seed",)),
    "no value": ("trajectories", ("trajectories",)),
}


def _before(text: str) -> Change:
    def spoil(place: Path) -> None:
        path = place / "poses.yaml"
        path.write_bytes(f"{text}\n".encode("utf-8", "surrogateescape") + path.read_bytes())

    return spoil


def learned_noise(place: Path) -> dict:
    """The small session and a noise.json of another, which is returned too."""
    from export.synthetic_learned import learned_noise

    from jaxgeo.export.noise_file import noise_json

    inputs.session()(place)
    text = noise_json("walk", False, {"icp": {"fixed": {}, "learned": learned_noise()}})
    (place / "noise.json").write_text(text)
    return json.loads(text)


def _with_noise(place: Path) -> None:
    learned_noise(place)


def _tampered(change: Callable[[dict], None]) -> Change:
    def spoil(place: Path) -> None:
        content = json.loads((place / "noise.json").read_text())
        change(content["trajectories"]["icp"]["learned"])
        (place / "noise.json").write_text(json.dumps(content))

    return spoil


def _first_sigma(value: float) -> Callable[[dict], None]:
    def change(learned: dict) -> None:
        learned["ensemble"]["sigma"][0][0] = value

    return change


def _components(learned: dict) -> None:
    learned["components"][0] = "'); DROP TABLE noise; --"


def _weights(learned: dict) -> None:
    learned["ensemble"]["weight"] = [2.0 for _ in learned["ensemble"]["weight"]]


def _not_symmetric(learned: dict) -> None:
    learned["theta_covariance"][0][1] += 1.0


_NOISES: dict[str, tuple[str, Callable[[dict], None], str]] = {
    "sigma negative": ("a sigma of -1", _first_sigma(-1.0), "sigma"),
    "sigma NaN": ("a sigma of NaN", _first_sigma(float("nan")), "sigma"),
    "sigma 1e308": ("a sigma of 1e308", _first_sigma(1e308), "noise.file"),
    "weights": ("weights that sum to more than 1", _weights, "weight"),
    "components": ("a component of another name", _components, "components"),
    "covariance": ("a covariance that is not symmetric", _not_symmetric, "theta_covariance"),
}


def config_cases() -> Iterator[Case]:
    """Hostile configs, values of --set, and files of noise."""
    for name, (done, text, says) in _TEXTS.items():
        yield Case(
            f"config: {name}",
            f"before the config: {done}",
            inputs.session(),
            ("run", "poses.yaml", "--dump-config"),
            _before(text),
            restored(inputs.session(), "poses.yaml"),
            says=says,
        )
    for name, (value, says) in _SETS.items():
        shown = value if len(value) < 80 else f"{value[:40]}…"
        arguments = ("run", "poses.yaml", "--set", value, "--quiet")
        yield Case(f"config: {name}", f"--set {shown}", inputs.session(), arguments, nothing, says=says)
    arguments = ("run", "poses.yaml", "--set", "noise.file=noise.json", "--set", "noise.use=fixed", *QUIET)
    for name, (done, change, says) in _NOISES.items():
        yield Case(
            f"noise.json: {name}",
            done,
            _with_noise,
            arguments,
            _tampered(change),
            _with_noise,
            says=(says,),
            codes=(2, 3),  # 3: numbers that can be noise, but under which there is no estimate
            results=RUN_RESULTS,
            limit_bytes=LIMIT_BYTES,
            limit_s=RUN_LIMIT_S,
        )
    yield Case(
        "noise.json: cut off",
        "half of its bytes",
        _with_noise,
        arguments,
        _halved,
        _with_noise,
        says=("noise.json",),
        results=RUN_RESULTS,
    )


def _halved(place: Path) -> None:
    data = (place / "noise.json").read_bytes()
    (place / "noise.json").write_bytes(data[: len(data) // 2])
