"""Effects and ``--set NAME=VALUE`` of the command line."""

from __future__ import annotations

from rigtwin.api.rigs import effect, effect_of
from rigtwin.api.values import as_kind
from rigtwin.errors import UserError
from rigtwin.rotor.effects import EFFECTS, Effect, Parameter
from rigtwin.wording import close_to


def parse_effects(ids: tuple[str, ...], settings: tuple[str, ...]) -> tuple[tuple[Effect, ...], tuple[str, ...]]:
    """Effects with the "ID.PARAM=VALUE" settings that are theirs, and all other settings. Raises UserError."""
    values: dict[str, dict[str, float | int]] = {key: {} for key in ids}
    for key in ids:
        try:
            effect_of(key)
        except UserError as error:
            raise UserError(f"--effect {key}: {error}") from None
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
    return tuple(effect(key, **given) for key, given in values.items()), tuple(others)


def _effect_value(setting: str, kind: type[Effect], parameter: str) -> float | int:
    if parameter not in kind.roles():
        guess, known = close_to(parameter, kind.roles()), ", ".join(kind.roles())
        raise UserError(f"--set {setting}: {kind.id} has no parameter {parameter}; {guess}it has {known}")
    role = kind.roles()[parameter]
    whole = not isinstance(role, Parameter) and role.kind == "node"
    name, _, text = setting.partition("=")
    return as_kind(f"--set {name}", text, "Integer" if whole else "Real")
