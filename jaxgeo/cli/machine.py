"""The machine in words, for figures that depend on it."""

import os
import platform
from pathlib import Path


def device_words() -> str:
    """Processor or accelerator, and how many."""
    import jax

    device = jax.devices()[0]
    if device.platform != "cpu":
        return f"{len(jax.devices())} x {device.device_kind}"
    return f"{_processor()}, {len(os.sched_getaffinity(0))} core(s)"


def _processor() -> str:
    """What Linux calls the processor; its architecture where it says nothing."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8", errors="replace").splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
