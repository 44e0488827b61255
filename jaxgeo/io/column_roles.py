"""Which column of a table means what: by its header, or by an explicit map."""

from collections.abc import Mapping

from jaxgeo.io.text_table import TextTable, column_index

Columns = Mapping[str, str | int]
"""What a column means -> its header name or 0-based index."""

Roles = Mapping[str, tuple[str, ...]]
"""What a column can mean -> the lower-case names that say so."""


def column_roles(table: TextTable, columns: Columns | None, roles: Roles, required: tuple[str, ...]) -> dict[str, int]:
    """Index of the column in every role that the table fills.

    Args:
        table: the table.
        columns: explicit map; only what it names is read. Default: by header name.
        roles: what can be read, and its accepted names, case ignored.
        required: roles that must be filled.

    Raises:
        table.error: an unknown key, a role filled twice, one column in two roles, or a required role left empty.
    """
    role_of = {name: role for role, names in roles.items() for name in names}
    found: dict[str, int] = {}
    given = {name: name for name in table.header if name.casefold() in role_of} if columns is None else columns
    if columns is None and len({name.casefold() for name in table.header}) < len(table.header):
        _refuse_repeated_names(table, role_of)
    for name, column in given.items():
        role = role_of.get(str(name).casefold())
        if role is None:
            raise table.error(f"{table.path}: columns: unknown key {name!r}; expected some of {', '.join(roles)}.")
        if role in found:
            raise table.error(f"{table.path}: {role} is given twice, the second time as {name!r}. Keep one of them.")
        found[role] = column_index(table, column)
    shared = [role for role, index in found.items() if list(found.values()).count(index) > 1]
    if shared:
        raise table.error(f"{table.path}: {' and '.join(shared)} both point at column {found[shared[0]]}.")
    missing = [role for role in required if role not in found]
    if missing:
        raise table.error(_missing(table, columns, missing, found, required))
    return found


def _refuse_repeated_names(table: TextTable, role_of: dict[str, str]) -> None:
    seen: dict[str, str] = {}
    for name in table.header:
        role = role_of.get(name.casefold())
        if role is not None and role in seen:
            raise table.error(f"{table.path}: the header gives {role} twice, as {seen[role]!r} and {name!r}. Keep one.")
        if role is not None:
            seen[role] = name


def _missing(
    table: TextTable, columns: Columns | None, missing: list[str], found: dict[str, int], required: tuple[str, ...]
) -> str:
    expected = ", ".join(required)
    if columns is not None:
        return (
            f"{table.path}: columns: no {', '.join(missing)}; given {', '.join(found)}, expected at least {expected}."
        )
    if not table.header:
        example = ", ".join(f"{role}: {i}" for i, role in enumerate(required))
        return (
            f"{table.path}: no header line names the {table.n_columns} columns. Add one ({expected}), or say which "
            f"column is which, counted from 0, such as columns: {{{example}}}."
        )
    one = " All stand in one column: is the separator another one (`delimiter`)?" if table.n_columns == 1 else ""
    return (
        f"{table.path}: no column for {', '.join(missing)}; the header has {', '.join(table.header)}, expected at "
        f"least {expected}. Rename the columns, or map them with `columns`.{one}"
    )
