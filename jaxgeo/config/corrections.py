"""What the config may say of a wrong clock and of a camera that is not where the rig file has it."""

from pydantic import Field, model_validator

from jaxgeo.config.fields import Positive, Section


class TimeOffset(Section):
    """Of the sightings' clock from the trajectory's. `sigma_s`: how far off it may well be."""

    sigma_s: Positive = 0.1


class LeverArm(Section):
    """Of the camera's place in the body. `sigma_m`: how far off each axis may well be."""

    sigma_m: Positive = 0.05


class CameraRotation(Section):
    """Of the camera's attitude in the body. `sigma_rad`: how far off each axis may well be."""

    sigma_rad: Positive = 0.02


class CorrectionsInput(Section):
    """Corrections to estimate beside the poses; one that is not named is not estimated.

    Attributes:
        time_offset, lever_arm, rotation: with the width of what is thought possible; {} for the default.
        apply: correct the sightings by what was found, inside every fold anew; false: only report it.
    """

    time_offset: TimeOffset | None = Field(default=None)
    lever_arm: LeverArm | None = Field(default=None)
    rotation: CameraRotation | None = Field(default=None)
    apply: bool = True

    @model_validator(mode="after")
    def _check_any(self):
        if self.time_offset is None and self.lever_arm is None and self.rotation is None:
            raise ValueError(
                "nothing to estimate: give time_offset, lever_arm or rotation ({} for the usual width), "
                "or remove 'corrections'"
            )
        return self

    @property
    def widths(self) -> tuple[float, float, float]:
        """Seconds, metres, radians; 0 where a correction is not estimated."""
        return (
            0.0 if self.time_offset is None else self.time_offset.sigma_s,
            0.0 if self.lever_arm is None else self.lever_arm.sigma_m,
            0.0 if self.rotation is None else self.rotation.sigma_rad,
        )
