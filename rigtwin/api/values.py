"""Values as the variables of an FMU have them."""

from __future__ import annotations

from rigtwin.errors import UserError


def as_kind(name: str, value: float | int | bool | str, kind: str) -> float | int | bool:
    """A value of the FMI type Boolean, Integer or Real; text is read. Raises UserError.

    >>> as_kind("rigid_support", "true", "Boolean"), as_kind("excitation_node", "3", "Integer")
    (True, 3)
    >>> as_kind("excitation_node", float("inf"), "Integer")
    Traceback (most recent call last):
        ...
    rigtwin.errors.UserError: excitation_node=inf: 'inf' is not a whole number
    """
    words = {"true": True, "false": False}
    try:
        if kind == "Boolean":
            return words[str(value).lower()]
        if kind == "Integer":
            return int(value) if isinstance(value, str) or int(value) == value else int(str(value))
        return float(value)
    except (KeyError, ValueError, OverflowError):
        wanted = {"Boolean": "true or false", "Integer": "a whole number"}.get(kind, "a number")
        raise UserError(f"{name}={value}: {str(value)!r} is not {wanted}") from None
