"""All effects by id, in the order of the documentation: that of these modules, and of the classes in each."""

from __future__ import annotations

from rigtwin.rotor.effects import chain, nonlinear, spinning, structure, supports
from rigtwin.rotor.effects.effect import Effect

EFFECTS: dict[str, type[Effect]] = {
    effect.id: effect
    for module in (structure, supports, nonlinear, chain, spinning)
    for effect in vars(module).values()
    if isinstance(effect, type) and issubclass(effect, Effect) and effect.__module__ == module.__name__
}
