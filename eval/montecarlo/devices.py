"""The devices that share the sessions. Has to be asked before JAX has started."""

import contextlib
import os
import re

import jax

# Kernels of batched small matrices (LAPACK, in jaxlib 0.10) wait in a thread of XLA's pool for others of the same pool:
# where as many wait as there are threads, all wait for ever. Four devices with four threads hung at once; a device
# has been seen to need two.
THREADS_A_DEVICE = 8
# A program for one device is compiled by other passes than one for several, and rounds elsewhere: with two devices at
# least, results are the same bits whatever their number.
FEWEST_CPU_DEVICES = 2


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def study_devices(wanted: int | None) -> list:
    """The first `wanted` devices that JAX sees, all by default; a CPU's cores are asked for as devices of their own.

    One CPU device runs these small programs on one core. Where JAX has started already, or its flags say how many CPU
    devices there are, it is left at that.
    """
    asked = max(wanted or cores(), FEWEST_CPU_DEVICES)
    if not _flagged():
        with contextlib.suppress(RuntimeError):  # JAX has started
            jax.config.update("jax_num_cpu_devices", asked)
    # Read when the CPU's devices are made; `import jaxgeo` has set it to some lower number.
    os.environ["NPROC"] = str(THREADS_A_DEVICE * max(asked, _flagged()))
    found = jax.devices()
    if wanted is None:
        return found
    return found[: max(wanted, FEWEST_CPU_DEVICES) if found[0].platform == "cpu" else wanted]


def _flagged() -> int:
    """CPU devices that XLA's flags ask for; 0: they do not say."""
    found = re.search(r"xla_force_host_platform_device_count=(\d+)", os.environ.get("XLA_FLAGS", ""))
    return int(found.group(1)) if found else 0
