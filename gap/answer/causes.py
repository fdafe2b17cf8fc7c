"""A fitted candidate as ``diagnosis.json`` names it: its effects, their places, and their numbers with errors."""

from __future__ import annotations

from rigtwin.gap.document import Cause, Estimate, Location
from rigtwin.gap.inference.fit import Fit
from rigtwin.gap.inference.hypotheses import Hypothesis
from rigtwin.rotor.model.arrays import FloatArray


def locations(hypothesis: Hypothesis, u: FloatArray) -> tuple[Location, ...]:
    """Where each effect is, for coordinates (1 + n_free,)."""
    found = []
    for term, own in zip(hypothesis.terms, hypothesis.split(u[1:]), strict=True):
        numbers = zip(term.free, own, strict=True)
        position = next((free.value(x) for free, x in numbers if free.name == "position"), None)
        node = next((int(value) for name, value in term.fixed if name == "node" and value), None)
        found.append(Location(term.effect.location, node, position))  # type: ignore[arg-type]
    return tuple(found)


def _places(hypothesis: Hypothesis, u: FloatArray) -> dict[str, float]:
    """Nodes and positions of all effects, by the effect's id and their own name."""
    found: dict[str, float] = {}
    for term, own in zip(hypothesis.terms, hypothesis.split(u[1:]), strict=True):
        free = {free.name: free.value(x) for free, x in zip(term.free, own, strict=True) if free.name == "position"}
        found |= {f"{term.effect.id}.{name}": value for name, value in [*term.fixed, *free.items()]}
    return found


def cause_of(
    hypothesis: Hypothesis,
    u: FloatArray,
    std: FloatArray,
    probability: float,
    k_b: Estimate | None,
    log_evidence: float,
) -> Cause:
    """A candidate as a cause.

    Parameters
    ----------
    u, std : (1 + n_free,) coordinates, k_b the first, and their standard errors
    probability, k_b, log_evidence : as in ``Cause``
    """
    parameters: dict[str, Estimate] = {}
    edge: list[str] = []
    parts = (hypothesis.split(values[1:]) for values in (u, std, hypothesis.at_edge(u).max(axis=1)))
    for term, *numbers in zip(hypothesis.terms, *parts, strict=True):
        prefix = "" if len(hypothesis.terms) == 1 else f"{term.effect.id}."
        for free, x, error, at_end in zip(term.free, *numbers, strict=True):
            name, value, is_place = f"{prefix}{free.name}", free.value(x), free.name == "position"
            unit = "m" if is_place else term.effect.parameters()[free.name].unit
            parameters[name] = Estimate(value, float(error * value if free.log else error), unit)
            if at_end and not is_place:
                edge.append(name)
    where = locations(hypothesis, u)
    return Cause(
        effects=hypothesis.ids,
        location=where[0],
        probability=probability,
        parameters=parameters,
        k_b=k_b,
        log_evidence=log_evidence,
        locations=where,
        places=_places(hypothesis, u),
        at_prior_edge=tuple(edge),
    )


def k_b_of(fit: Fit, std: FloatArray) -> Estimate | None:
    """Bearing stiffness of a fit, by standard errors as ``cause_of`` has them; None where no run is on bearings."""
    return Estimate(fit.k_b, fit.k_b * float(std[0]), "N/m") if fit.with_k_b else None
