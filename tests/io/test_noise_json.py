"""noise.json of another session: read back as it was written, or refused with file and key."""

import dataclasses
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from export.synthetic_learned import learned_noise

from calibration.models import family_prior
from jaxgeo.cli.noise import session_prior
from jaxgeo.errors import ConfigError
from jaxgeo.export.noise_file import noise_json
from jaxgeo.graph.components import COMPONENTS
from jaxgeo.graph.noise_defaults import default_noise
from jaxgeo.io.noise_json import read_noise


@pytest.fixture
def written(tmp_path) -> Callable[..., Any]:
    """Writes a noise.json of one or more trajectories, changed by a function, and returns its path."""

    def write(change: Callable[[dict], None] = lambda learned: None, names: tuple[str, ...] = ("icp",)):
        path = tmp_path / "noise.json"
        noise = {name: {"fixed": {}, "learned": learned_noise()} for name in names}
        change(noise[names[0]]["learned"])
        path.write_text(noise_json("walk", False, noise))
        return path

    return write


def refusal(path, trajectory: str | None = None) -> str:
    with pytest.raises(ConfigError) as error:
        read_noise(path, COMPONENTS, trajectory)
    text = str(error.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    return text


def test_reads_what_was_written(written):
    stored, learned = read_noise(written(), COMPONENTS), learned_noise()
    assert (stored.session, stored.trajectory, stored.kind, stored.observations) == ("walk", "icp", "lidar", "both")
    np.testing.assert_array_equal(stored.theta_mean, learned["theta_mean"])
    np.testing.assert_array_equal(stored.theta_covariance, learned["theta_covariance"])
    np.testing.assert_array_equal(stored.sigma, learned["ensemble"]["sigma"])
    np.testing.assert_allclose(stored.weight, learned["ensemble"]["weight"], rtol=1e-15)
    assert stored.correlation_m == 12.5


def test_a_pooled_covariance_says_that_it_is_one(written):
    assert read_noise(written(), COMPONENTS).between_sessions is False
    pooled = read_noise(written(lambda learned: learned.update(between_sessions=True)), COMPONENTS)
    assert pooled.between_sessions is True
    family = family_prior("lidar", default_noise("lidar"))
    widened = session_prior(dataclasses.replace(pooled, between_sessions=False), family).covariance
    np.testing.assert_array_equal(session_prior(pooled, family).covariance, pooled.theta_covariance)
    assert (np.diag(widened) > np.diag(pooled.theta_covariance)).all()


def test_components_come_in_the_order_asked_for(written):
    asked = tuple(reversed(COMPONENTS))
    here, there = read_noise(written(), COMPONENTS), read_noise(written(), asked)
    np.testing.assert_array_equal(there.theta_mean, here.theta_mean[::-1])
    np.testing.assert_array_equal(there.theta_covariance, here.theta_covariance[::-1, ::-1])
    np.testing.assert_array_equal(there.sigma, here.sigma[:, ::-1])


def test_one_of_several_trajectories_must_be_named(written):
    path = written(names=("icp", "dense"))
    assert "holds 2 trajectories (icp, dense); expected one, or one of them named: noise.trajectory" in refusal(path)
    assert "has no trajectory 'vio', which noise.trajectory names (known: icp, dense)" in refusal(path, "vio")
    assert read_noise(path, COMPONENTS, "dense").trajectory == "dense"


def set_to(*keys: str, value: Any) -> Callable[[dict], None]:
    def change(learned: dict) -> None:
        for key in keys[:-1]:
            learned = learned[key]
        learned[keys[-1]] = value

    return change


NEGATIVE = np.diag([-1.0, *np.ones(len(COMPONENTS) - 1)]).tolist()
HUGE = np.full((len(COMPONENTS), len(COMPONENTS)), 1.7e308).tolist()
ASYMMETRIC = (np.eye(len(COMPONENTS)) + np.eye(len(COMPONENTS), k=1)).tolist()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            set_to("theta_mean", value=[1.0]),
            "learned.theta_mean does not hold what it should; expected 16 finite numbers",
        ),
        (set_to("theta_mean", value=["a"] * 16), "theta_mean does not hold"),
        (set_to("theta_mean", value=[None] * 16), "theta_mean does not hold"),
        (set_to("theta_covariance", value=NEGATIVE), "theta_covariance is not a covariance"),
        (set_to("theta_covariance", value=ASYMMETRIC), "theta_covariance is not a covariance"),
        (set_to("theta_covariance", value=HUGE), "theta_covariance is not a covariance"),
        (set_to("components", value=[*COMPONENTS[:-1], "tide_m"]), "(anchor_factor, tide_m): learn it anew"),
        (set_to("components", value=[*COMPONENTS[:-1], COMPONENTS[0]]), "learn it anew"),
        (set_to("components", value=None), "components differs"),
        (set_to("ensemble", value=None), "learned.ensemble is missing; expected a mapping"),
        (set_to("ensemble", "weight", value=[]), "ensemble.weight does not hold what it should; expected n finite"),
        (set_to("ensemble", "weight", value=[0.5, 0.5, 0.5, 0.5]), "weight sums to 2; expected non-negative"),
        (set_to("ensemble", "weight", value=[-0.5, 0.5, 0.5, 0.5]), "weight sums to 1; expected non-negative"),
        (set_to("ensemble", "sigma", value=[[0.1] * 16] * 3), "ensemble.sigma does not hold"),
        (set_to("ensemble", "sigma", value=[[-0.1] * 16] * 4), "sigma holds -0.1; expected standard deviations"),
        (set_to("ensemble", "sigma", value=[[0.0] * 16] * 4), "zero everywhere"),
        (set_to("ensemble", "correlation_m", value=0.0), "correlation_m is 0; expected a length above 0"),
        (set_to("ensemble", "correlation_m", value=None), "correlation_m does not hold"),
    ],
)
def test_numbers_that_cannot_be_noise_are_refused(written, change, words):
    assert words in refusal(written(change))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "the file is empty"),
        ('{"trajectories": {"icp": {"learned"', ":1: Expecting ':' delimiter: not JSON"),
        ("[" * 200_000, "not JSON"),
        ("[1, 2]", "holds a list; expected a noise.json"),
        ("{}", "trajectories is missing; expected a mapping. Is this a noise.json?"),
        ('{"trajectories": {}}', "holds no trajectory"),
        ('{"trajectories": {"icp": 3}}', "trajectories.icp is a int"),
        ('{"trajectories": {"icp": {"fixed": {}}}}', "trajectories.icp holds no learned noise, only a fixed one"),
    ],
)
def test_files_that_are_no_noise_json_are_refused(tmp_path, text, words):
    path = tmp_path / "n.json"
    path.write_text(text)
    assert words in refusal(path)


def test_a_missing_file_is_named(tmp_path):
    assert "no such file" in refusal(tmp_path / "none.json")


def test_what_is_not_a_number_is_never_written(written):
    def broken(learned: dict) -> None:
        learned["sigmas"][0]["median"] = float("nan")

    text = written(broken).read_text()
    assert json.loads(text)["trajectories"]["icp"]["learned"]["sigmas"][0]["median"] is None
    assert "NaN" not in text
