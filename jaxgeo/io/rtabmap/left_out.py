"""What was not taken over from a database, and why."""

import dataclasses


@dataclasses.dataclass
class LeftOut:
    """Counts by kind of thing, each with the first reason met.

    Attributes:
        count: kind -> how many.
        first: kind -> the message of the first one.
    """

    count: dict[str, int] = dataclasses.field(default_factory=dict)
    first: dict[str, str] = dataclasses.field(default_factory=dict)

    def add(self, kind: str, why: str, number: int = 1) -> None:
        self.count[kind] = self.count.get(kind, 0) + number
        self.first.setdefault(kind, why)

    def sentences(self) -> list[str]:
        """One a kind, for a person."""
        return [f"{count} {kind} left out; the first: {self.first[kind]}" for kind, count in self.count.items()]
