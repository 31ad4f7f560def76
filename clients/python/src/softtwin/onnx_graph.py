"""A model as an ONNX graph, for runtimes of neural networks: `softtwin.Model("finger.twin").to_onnx("finger.onnx")`.

The equations are evaluated once over `_Tensor`, whose operators write the nodes of the graph.
"""

import json
from typing import TYPE_CHECKING, Any, Callable, Dict, List, Sequence

import numpy as np

from .equations import GAP, PRESSURE, Equations, bracketed

if TYPE_CHECKING:
    from .model import Model

_OPSET = 18


class _Tensor:
    """A value of the graph."""

    __array_ufunc__ = None  # numpy leaves its operators to this class

    def __init__(self, graph: "_Graph", name: str) -> None:
        self.graph, self.name = graph, name

    def __getitem__(self, key: Any) -> "_Tensor":
        if key == (..., None):
            return self.graph.node("Unsqueeze", self, np.array([-1]))
        if key == (..., 0):
            return self.graph.node("Squeeze", self[..., :1], np.array([-1]))
        end = np.iinfo(np.int64).max if key[1].stop is None else key[1].stop
        return self.graph.node("Slice", self, np.array([key[1].start or 0]), np.array([end]), np.array([-1]))

    def __pow__(self, power: int) -> "_Tensor":
        square = self.graph.node("Mul", self, self)
        return square if power == 2 else self.graph.node("Div", 1.0, square)

    def __neg__(self) -> "_Tensor":
        return self.graph.node("Neg", self)

    def __invert__(self) -> "_Tensor":
        return self.graph.node("Not", self)


def _operator(kind: str, is_reflected: bool) -> Callable[[_Tensor, Any], _Tensor]:
    def write(self: _Tensor, other: Any) -> _Tensor:
        return self.graph.node(kind, *((other, self) if is_reflected else (self, other)))

    return write


for _name, _kind in {"add": "Add", "sub": "Sub", "mul": "Mul", "truediv": "Div", "matmul": "MatMul", "and": "And", "or": "Or"}.items():
    setattr(_Tensor, f"__{_name}__", _operator(_kind, False))
    setattr(_Tensor, f"__r{_name}__", _operator(_kind, True))
for _name, _kind in {"lt": "Less", "le": "LessOrEqual", "gt": "Greater", "ge": "GreaterOrEqual", "eq": "Equal"}.items():
    setattr(_Tensor, f"__{_name}__", _operator(_kind, False))


class _Graph:
    """The functions of `jax.numpy` that the equations call, which write nodes."""

    asarray = staticmethod(np.asarray)

    def __init__(self, onnx: Any) -> None:
        self.onnx, self.nodes, self.constants, self.count = onnx, [], {}, 0  # type: ignore[var-annotated]

    def _new(self) -> _Tensor:
        self.count += 1
        return _Tensor(self, f"t{self.count}")

    def _constant(self, value: Any) -> str:
        array = np.asarray(value)
        array = array.astype(np.int64 if array.dtype.kind == "i" and array.ndim else np.float64)
        key = (array.dtype.str, array.shape, array.tobytes())
        return str(self.constants.setdefault(key, (f"c{len(self.constants)}", array))[0])

    def node(self, kind: str, *inputs: Any, **attributes: Any) -> Any:
        names = [value.name if isinstance(value, _Tensor) else self._constant(value) for value in inputs]
        out = self._new()
        self.nodes.append(self.onnx.helper.make_node(kind, names, [out.name], **attributes))
        return out

    def __getattr__(self, name: str) -> Callable[..., Any]:
        kinds = {"where": "Where", "exp": "Exp", "log": "Log", "sqrt": "Sqrt", "tanh": "Tanh", "abs": "Abs", "floor": "Floor", "maximum": "Max", "minimum": "Min"}
        return lambda *inputs: self.node(kinds[name], *inputs)

    def sum(self, value: Any, axis: int) -> Any:
        return self.node("ReduceSum", value, np.array([axis]), keepdims=0)

    def min(self, value: Any, axis: int) -> Any:
        return self.node("ReduceMin", value, np.array([axis]), keepdims=0)

    def max(self, value: Any, axis: int) -> Any:
        return self.node("ReduceMax", value, np.array([axis]), keepdims=0)

    def expm1(self, value: Any) -> Any:
        return self.exp(value) - 1.0

    def take(self, value: Any, indices: Any, axis: int) -> Any:
        whole = self.node("Cast", indices, to=self.onnx.TensorProto.INT64) if isinstance(indices, _Tensor) else np.asarray(indices, np.int64)
        return self.node("Gather", value, whole, axis=axis)

    def concatenate(self, values: Sequence[Any], axis: int) -> Any:
        return self.node("Concat", *values, axis=axis)

    def arctan2(self, y: Any, x: Any) -> Any:
        """By its series: runtimes have an arc tangent of 32 bits alone. The angle is that of the smaller over the larger, halved three times."""
        is_steep = self.abs(y) > self.abs(x)
        ratio = self.where(is_steep, x, y) / self.where(is_steep, y, x)
        for _ in range(3):
            ratio = ratio / (1.0 + self.sqrt(1.0 + ratio * ratio))
        series = 0.0 * ratio
        for term in range(13, 0, -2):
            series = 1.0 / term - ratio * ratio * series
        angle = 8.0 * ratio * series
        steep = self.where(y < 0.0, -0.5 * np.pi, 0.5 * np.pi) - angle
        flat = angle + self.where(x < 0.0, self.where(y < 0.0, -np.pi, np.pi), 0.0)
        return self.where(is_steep, steep, flat)

    def repeat(self, count: int, body: Callable[[Any, Any], Any], start: Any) -> Any:
        for at in range(count):
            start = body(at, start)
        return start

    def solve(self, *arguments: Any) -> Any:
        return bracketed(self, *arguments)


def _used(nodes: List[Any], wanted: Sequence[str]) -> List[Any]:
    """The nodes that these values depend on."""
    needed, found = set(wanted), []
    for node in reversed(nodes):
        if needed.intersection(node.output):
            needed.update(node.input)
            found.append(node)
    return found[::-1]


def to_onnx(model: "Model", path: str, fields: bool) -> None:
    try:
        import onnx
    except ImportError as error:
        raise ImportError("Model.to_onnx needs onnx, which is not installed: pip install softtwin[onnx]") from error
    graph = _Graph(onnx)
    equations = Equations(graph, model, fields)
    double, names = onnx.TensorProto.DOUBLE, {at: name for name, at in model._position.items()}
    absent = {PRESSURE: 0.0, GAP: np.inf}
    first: Any = _Tensor(graph, next(iter(model.inputs)))
    values: List[Any] = [_Tensor(graph, names[at]) if at in names else 0.0 * first + absent[at] for at in range(model._width)]
    answer = equations.answer([value[..., None] for value in values])
    units: Dict[str, str] = {name: spec.unit for name, spec in model.inputs.items()}
    for name, value in answer.items():
        whole = value if name in equations.published else value[..., 0]
        graph.nodes.append(onnx.helper.make_node("Identity", [whole.name], [name]))
        units[name] = model.fields.get(name) or model.columns.get(name, "")
    nodes = _used(graph.nodes, list(answer))
    known = {name for node in nodes for name in node.input}
    info = onnx.helper.make_tensor_value_info
    shapes: Dict[str, List[Any]] = {name: ["states", model.node_count] if name in equations.published else ["states"] for name in answer}
    made = onnx.helper.make_model(
        onnx.helper.make_graph(
            nodes,
            model.actuator,
            [info(name, double, ["states"]) for name in model.inputs],
            [info(name, double, shape) for name, shape in shapes.items()],
            [onnx.numpy_helper.from_array(array, name) for name, array in graph.constants.values() if name in known],
        ),
        opset_imports=[onnx.helper.make_opsetid("", _OPSET)],
        producer_name="softtwin",
        ir_version=9,
    )
    onnx.helper.set_model_props(made, {"units": json.dumps(units)})
    onnx.save(made, path)
