"""One kind of bad input, and what must be said of it."""

import dataclasses

from cli.spoil import Spoil, nothing


@dataclasses.dataclass(frozen=True)
class Case:
    """`session` names the config, `says` is what the message must match, `set_` what --set is given."""

    id: str
    session: str
    spoil: Spoil
    code: int
    says: tuple[str, ...]
    set_: tuple[str, ...] = ()


def bad(id: str, session: str, spoil: Spoil, *says: str, code: int = 2, set_: tuple[str, ...] = ()) -> Case:
    return Case(id, session, spoil, code, says, set_)


def with_set(id: str, session: str, override: str, *says: str, code: int = 2) -> Case:
    return Case(id, session, nothing, code, says, (override,))
