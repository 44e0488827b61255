"""float64 everywhere, and what becomes of compiled programs: kept on disk, let go where they take too much."""

import os
from pathlib import Path

import jax
import jax.numpy as jnp


def enable_float64() -> None:
    """Make float64 JAX's default. Called once, on `import jaxgeo`."""
    jax.config.update("jax_enable_x64", True)


def assert_float64() -> None:
    """Refuse to estimate in single precision.

    Raises:
        RuntimeError: float64 was switched off after `import jaxgeo`.
    """
    if jnp.zeros(()).dtype != jnp.float64:
        raise RuntimeError(
            "jaxgeo estimates in float64, but JAX is in float32: remove jax_enable_x64=False from your program "
            "(one float32 step at UTM northings is half a metre)."
        )


def enable_compilation_cache(folder: Path | None = None) -> Path:
    """Keep compiled programs on disk, so that a second process starts at once.

    Args:
        folder: where to keep them; default `$JAXGEO_CACHE`, else `~/.cache/jaxgeo/xla`.
    """
    if folder is None:
        folder = Path(os.environ.get("JAXGEO_CACHE") or Path.home() / ".cache" / "jaxgeo" / "xla")
    folder.mkdir(parents=True, exist_ok=True)
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
    return folder


# A compiled program takes hundreds of memory maps; Linux gives a process 65 530, and XLA crashes without a word when
# they run out. Ten sessions of different shapes take 35 000.
MANY_MAPS = 20_000


def let_programs_go(most_maps: int = MANY_MAPS) -> bool:
    """Drop compiled programs where they take too much; those that are needed again come from the cache on disk.

    Call it between sessions. Returns whether it was needed; elsewhere than on Linux it never is.
    """
    maps = Path("/proc/self/maps")
    if not maps.exists() or len(maps.read_text(encoding="utf-8").splitlines()) <= most_maps:
        return False
    jax.clear_caches()
    return True
