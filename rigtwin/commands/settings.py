"""Effects and ``--set NAME=VALUE`` of the command line."""

from __future__ import annotations

from rigtwin.exits import UserError
from rigtwin.rotor.effects import EFFECTS, Effect, Parameter


def parse_effects(ids: tuple[str, ...], settings: tuple[str, ...]) -> tuple[tuple[Effect, ...], tuple[str, ...]]:
    """Effects with the "ID.PARAM=VALUE" settings that are theirs, and all other settings. Raises UserError."""
    values: dict[str, dict[str, float | int]] = {key: {} for key in ids}
    for key in ids:
        if key not in EFFECTS:
            raise UserError(f"--effect {key}: there is no such effect; there are {', '.join(EFFECTS)}")
        if ids.count(key) > 1:
            raise UserError(
                f"--effect {key}: given twice; give it once, and its parameters with --set {key}.NAME=VALUE"
            )
    others = []
    for setting in settings:
        key, dot, parameter = setting.partition("=")[0].partition(".")
        if not dot or key not in EFFECTS:
            others.append(setting)
        elif key not in values or parameter == "enabled":
            raise UserError(f"--set {setting}: an effect is switched on with --effect {key}")
        else:
            values[key][parameter] = _effect_value(setting, EFFECTS[key], parameter)
    try:
        return tuple(EFFECTS[key](**given) for key, given in values.items()), tuple(others)
    except ValueError as error:  # says the effect and the parameter
        raise UserError(str(error)) from error


def _effect_value(setting: str, effect: type[Effect], parameter: str) -> float | int:
    if parameter not in effect.roles():
        raise UserError(
            f"--set {setting}: {effect.id} has no parameter {parameter}; it has {', '.join(effect.roles())}"
        )
    role = effect.roles()[parameter]
    whole = not isinstance(role, Parameter) and role.kind == "node"
    return value_of(setting, setting.partition("=")[2], "Integer" if whole else "Real")


def value_of(setting: str, text: str, kind: str) -> float | int | bool:
    """The number or truth value in a text, of the kind that an FMU variable has. Raises UserError."""
    words = {"true": True, "false": False}
    try:
        return words[text.lower()] if kind == "Boolean" else int(text) if kind == "Integer" else float(text)
    except (KeyError, ValueError):
        wanted = {"Boolean": "true or false", "Integer": "a whole number"}.get(kind, "a number")
        raise UserError(f"--set {setting}: {text!r} is not {wanted}") from None
