"""C code of a small ONNX network, for one row of inputs.

Every tensor is followed element by element while the code is printed: slices, stacks and the like
vanish, sums over a few elements become expressions, and only the layers of the network remain as
loops over their weights. Arithmetic is that of the file, float32. ``layer`` and ``tanh_of``, which
the code calls, stand in ``native/layer.h``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import numpy_helper

_INCLUDE = '#include "layer.h"\n'

# Names of C expressions, or numbers, one for each element of a tensor.
Tensor = NDArray[np.object_]

# Neurons of a layer with tanh; ``WIDEST`` of native/layer.h.
WIDEST = 64


class UnknownOperationError(ValueError):
    """The network uses an operation that cannot be printed."""


@dataclass
class _Printer:
    """The code so far, and what its tensors are."""

    lines: list[str] = field(default_factory=list)
    tables: list[str] = field(default_factory=list)
    tensors: dict[str, Tensor] = field(default_factory=dict)
    count: int = 0

    def name(self, letter: str) -> str:
        self.count += 1
        return f"{letter}{self.count}"

    def each(self, write: Callable[..., str], *operands: Tensor) -> Tensor:
        """A new scalar for every element, of the operands' elements."""
        operands = np.broadcast_arrays(*operands)
        result = np.empty(operands[0].shape, dtype=object)
        for place in np.ndindex(*result.shape):
            name = self.name("t")
            self.lines.append(f"    const float {name} = {write(*(_text(o[place]) for o in operands))};")
            result[place] = name
        return result

    def layer(self, x: Tensor, weights: NDArray, bias: NDArray | None) -> Tensor:
        """weights x + bias; x is (1, n), weights (m, n)."""
        m, n = weights.shape
        if m > 1 and m % 4:
            raise UnknownOperationError(f"a layer of {m} neurons: the printed code takes them four at a time")
        inputs, output, table = self._row(x), self.name("a"), self._table(weights.T)
        added = self._table(np.zeros(m) if bias is None else bias)
        self.lines.append(f"    float {output}[{m}];")
        self.lines.append(f"    layer({m}, {n}, {table}, {added}, {inputs}, {output});")
        return np.array([[f"{output}[{k}]" for k in range(m)]], dtype=object)

    def activation(self, x: Tensor) -> Tensor:
        """tanh of a long row."""
        if x.size > WIDEST:
            raise UnknownOperationError(f"tanh of {x.size} neurons: the C code takes {WIDEST} of them at most")
        output = self.name("a")
        self.lines.append(f"    float {output}[{x.size}];")
        self.lines.append(f"    tanh_of({x.size}, {self._row(x)}, {output});")
        return np.array([[f"{output}[{k}]" for k in range(x.size)]], dtype=object)

    def _row(self, x: Tensor) -> str:
        """Name of an array that holds these elements."""
        elements = [_text(e) for e in x.ravel()]
        base = elements[0].partition("[")[0]
        if elements == [f"{base}[{k}]" for k in range(len(elements))]:
            return base
        name = self.name("a")
        self.lines.append(f"    const float {name}[{len(elements)}] = {{{', '.join(elements)}}};")
        return name

    def each_of_row(self, write: str, operands: Sequence[str], n: int) -> Tensor:
        """A loop over long rows; ``write`` with {0}, {1} for the operands' elements."""
        name = self.name("a")
        self.lines.append(f"    float {name}[{n}];")
        self.lines.append(f"    for (int k = 0; k < {n}; k++)")
        self.lines.append(f"        {name}[k] = {write.format(*operands)};")
        return np.array([[f"{name}[{k}]" for k in range(n)]], dtype=object)

    def _table(self, values: NDArray) -> str:
        name = self.name("W")
        self.tables.append(float_table(name, values))
        return name


def float_table(name: str, values: NDArray) -> str:
    """A table of single-precision numbers in C."""
    written = ", ".join(_text(v) for v in np.asarray(values, dtype=np.float32).ravel())
    return f"static const float {name}[] = {{{written}}};\n"


def network_code(file: Path, function: str) -> str:
    """C source of ``void function(const float *features, float *estimate)`` of an ONNX file.

    Raises UnknownOperationError.
    """
    printer = _Printer()
    graph = onnx.load(file).graph
    constants = {i.name: numpy_helper.to_array(i) for i in graph.initializer}
    for name, values in constants.items():
        printer.tensors[name] = _constant(values)
    (given,), (wanted,) = graph.input, graph.output
    n_inputs = given.type.tensor_type.shape.dim[1].dim_value
    printer.tensors[given.name] = np.array([[f"features[{k}]" for k in range(n_inputs)]], dtype=object)
    for node in graph.node:
        _print_node(printer, node, constants)
    answers = [f"    estimate[{k}] = {_text(e)};" for k, e in enumerate(printer.tensors[wanted.name].ravel())]
    head = [_INCLUDE, "".join(printer.tables), f"void {function}(const float *features, float *estimate)", "{"]
    return "\n".join([*head, *printer.lines, *answers, "}", ""])


def _constant(values: NDArray) -> Tensor:
    result = np.empty(values.shape, dtype=object)
    for place in np.ndindex(*values.shape):
        result[place] = values[place].item()
    return result


def _text(element: Any) -> str:
    """A C expression; floats keep every bit that a float32 has."""
    if isinstance(element, str):
        return element
    if isinstance(element, bool | int):
        return str(int(element))
    if not np.isfinite(element):
        return "INFINITY" if element > 0 else "-INFINITY"
    short = repr(float(np.float32(element))) if float(np.float32(element)) != element else f"{np.float32(element)!s}"
    return f"{short}f" if any(c in short for c in ".e") else f"{short}.0f"


_EACH = {
    "Add": "{} + {}",
    "Sub": "{} - {}",
    "Mul": "{} * {}",
    "Div": "{} / {}",
    "Max": "fmaxf({}, {})",
    "Min": "fminf({}, {})",
    "Log": "logf({})",
    "Exp": "expf({})",
    "Sqrt": "sqrtf({})",
    "Abs": "fabsf({})",
    "Neg": "-{}",
    "Reciprocal": "1 / {}",
    "Tanh": "tanhf({})",
    "GreaterOrEqual": "{} >= {}",
    "LessOrEqual": "{} <= {}",
    "Less": "{} < {}",
    "And": "{} && {}",
    "Clip": "fminf(fmaxf({}, {}), {})",
}

_LONG = 8  # rows of so many elements become loops


def _print_node(p: _Printer, node: onnx.NodeProto, constants: dict[str, NDArray]) -> None:
    inputs = [p.tensors[name] for name in node.input if name]
    options = {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
    p.tensors[node.output[0]] = _result(p, node.op_type, inputs, options, [constants.get(n) for n in node.input])


def _result(
    p: _Printer, kind: str, inputs: list[Tensor], options: dict[str, Any], known: list[NDArray | None]
) -> Tensor:
    x = inputs[0]
    if kind == "Tanh" and x.size >= _LONG:
        return p.activation(x)
    if kind in _EACH:
        return _elementwise(p, _EACH[kind], inputs)
    if kind == "Pow":
        if known[1] is None or float(known[1]) != 2.0:
            raise UnknownOperationError("a power other than a square")
        return _elementwise(p, "{0} * {0}", inputs[:1])
    if kind == "Cast":
        return x
    if kind == "Slice":
        start, stop, axis, step = (int(np.ravel(k)[0]) for k in known[1:5] if k is not None)
        places = [slice(None)] * x.ndim
        places[axis] = slice(start, stop, step)
        return x[tuple(places)]
    if kind == "Gather":
        assert known[1] is not None
        return np.take(x, known[1].astype(int), axis=options.get("axis", 0))
    if kind == "Unsqueeze":
        assert known[1] is not None
        return np.expand_dims(x, tuple(int(k) for k in np.ravel(known[1])))
    if kind == "Concat":
        return np.concatenate(inputs, axis=options["axis"])
    if kind in ("ReduceSum", "ReduceMin"):
        return _reduced(p, kind, x, known[1], options)
    if kind in ("Gemm", "MatMul"):
        return _product(p, x, known, options)
    raise UnknownOperationError(f"the network uses {kind}, which cannot be printed as C")


def _elementwise(p: _Printer, write: str, inputs: list[Tensor]) -> Tensor:
    shape = np.broadcast_shapes(*(i.shape for i in inputs))
    if np.prod(shape) < _LONG:
        return p.each(write.format, *inputs)
    operands = [p._row(i) + "[k]" if i.size > 1 else _text(i.ravel()[0]) for i in inputs]
    return p.each_of_row(write, operands, int(np.prod(shape)))


def _reduced(p: _Printer, kind: str, x: Tensor, axes: NDArray | None, options: dict[str, Any]) -> Tensor:
    assert axes is not None
    (axis,) = (int(k) for k in np.ravel(axes))
    parts = np.moveaxis(x, axis, 0)
    join = " + ".join if kind == "ReduceSum" else " && ".join
    result = p.each(lambda *terms: join(terms), *parts)
    return np.expand_dims(result, axis) if options.get("keepdims", 1) else result


def _product(p: _Printer, x: Tensor, known: list[NDArray | None], options: dict[str, Any]) -> Tensor:
    weights, bias = known[1], known[2] if len(known) > 2 else None
    scaled = options.get("alpha", 1.0) != 1.0 or options.get("beta", 1.0) != 1.0
    if weights is None or scaled or options.get("transA"):
        raise UnknownOperationError("a product of two tensors that are both inputs, or one that is scaled")
    return p.layer(x, weights if options.get("transB") else weights.T, bias)
