"""What the config may say of corrections, and what it refuses."""

import pytest
from pydantic import ValidationError

from jaxgeo.config.corrections import CorrectionsInput


def test_what_is_not_named_is_not_estimated():
    found = CorrectionsInput.model_validate({"time_offset": {}, "rotation": {"sigma_rad": 0.01}})
    assert found.widths == (0.1, 0.0, 0.01)
    assert found.apply


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ({}, "nothing to estimate"),
        ({"apply": True}, "nothing to estimate"),
        ({"time_offset": {"sigma_s": 0.0}}, "greater than 0"),
        ({"lever_arm": {"sigma_s": 0.1}}, "sigma_m"),
        ({"time_ofset": {}}, "did you mean 'time_offset'"),
    ],
)
def test_a_wrong_section_is_refused(value, words):
    with pytest.raises(ValidationError, match=words):
        CorrectionsInput.model_validate(value)
