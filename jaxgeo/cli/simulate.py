"""`jaxgeo simulate`: sessions with known truth as files, faults put in on demand."""

from pathlib import Path

from jaxgeo.errors import InputError
from jaxgeo.io.atomic import check_output_folder
from jaxgeo.simulate import UAV, UGV, Faults, drift_of, simulate_session, write_session_files

LAYOUTS = {"uav": UAV, "ugv": UGV}


def simulate_files(out: Path, seed: int, session: str, drift: str, faults: Faults) -> list[Path]:
    """Write the session `uav` or `ugv` into `out`, or `both`, each into its folder there; the configs' paths.

    Raises:
        InputError: no such session or drift, a fault that the session cannot have, or a folder that cannot be
            written to.
    """
    if session not in (*LAYOUTS, "both"):
        raise InputError(f"--session {session!r}: expected {', '.join(LAYOUTS)} or both.")
    check_output_folder(out)
    layouts = list(LAYOUTS.values()) if session == "both" else [LAYOUTS[session]]
    # All of them before the first is written.
    made = [simulate_session(seed, layout, drift=drift_of(drift, layout), faults=faults) for layout in layouts]
    folders = [out / one.layout.name.lower() for one in made] if session == "both" else [out]
    return [write_session_files(one, folder) for one, folder in zip(made, folders, strict=True)]


def faults_of(
    swap_visits: list[str], swap_locations: list[str], shift: list[str], label: list[str], time_offset_s: float
) -> Faults:
    """Faults from the words of the command line: `2,5`, `B,E`, `C=5,0,0`, `3=D`.

    Raises:
        InputError: words of another form, naming the option.
    """
    return Faults(
        shifted_enh_m=tuple(_shift(text) for text in shift),
        swapped_locations=tuple(_pair("--swap-locations", text, "two locations: B,E") for text in swap_locations),
        swapped_visits=tuple(_visits(text) for text in swap_visits),
        mislabelled_visits=tuple(_label(text) for text in label),
        time_offset_s=time_offset_s,
    )


def _pair(option: str, text: str, expected: str) -> tuple[str, str]:
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 2 or not all(parts):
        raise InputError(f"{option} {text!r}: expected {expected}.")
    return parts[0], parts[1]


def _visits(text: str) -> tuple[int, int]:
    expected = "two visits, counted from 1: 2,5"
    one, other = _pair("--swap-visits", text, expected)
    try:
        return int(one), int(other)
    except ValueError:
        raise InputError(f"--swap-visits {text!r}: expected {expected}.") from None


def _shift(text: str) -> tuple[str, tuple[float, float, float]]:
    name, _, numbers = text.partition("=")
    try:
        east, north, up = (float(number) for number in numbers.split(","))
    except ValueError:
        raise InputError(f"--shift {text!r}: expected a location and metres E, N, h: C=5,0,0.") from None
    return name.strip(), (east, north, up)


def _label(text: str) -> tuple[int, str]:
    visit, _, name = text.partition("=")
    try:
        return int(visit), name.strip()
    except ValueError:
        raise InputError(f"--label {text!r}: expected a visit, counted from 1, and a location: 3=D.") from None
