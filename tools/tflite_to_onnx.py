"""Write a TensorFlow Lite graph as ONNX: the operators of the pose and hand networks, no more.

TensorFlow Lite lays images out as NHWC, ONNX as NCHW; inputs and outputs keep their shapes. The
weights stay in half precision where the original stores them so: a Cast that ONNX Runtime folds
when it loads the file makes them single precision, so nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import onnx
from ai_edge_litert import schema_py_generated as tfl
from onnx import TensorProto, helper, numpy_helper

OPSET = 17


def names_of(enumeration: type) -> dict[int, str]:
    return {value: name for name, value in vars(enumeration).items() if isinstance(value, int)}


OPERATORS = names_of(tfl.BuiltinOperator)
ACTIVATIONS = names_of(tfl.ActivationFunctionType)
DTYPES: dict[int, type[np.generic]] = {
    tfl.TensorType.FLOAT32: np.float32,
    tfl.TensorType.FLOAT16: np.float16,
    tfl.TensorType.INT32: np.int32,
}


def densify(values: np.ndarray, shape: Sequence[int], sparsity: Any) -> np.ndarray:
    """Expand a TACO-style sparse tensor, as `DENSIFY` would at run time.

    Levels are stored in traversal order; a dense level counts, a compressed level lists the
    indices that occur. Blocks are further levels that refine one of the tensor's dimensions.
    """
    rank = len(shape)
    order = list(sparsity.traversalOrder)
    blocks = list(sparsity.blockMap) if sparsity.blockMap is not None else []
    levels = sparsity.dimMetadata
    block_size = [1] * rank
    for level, dimension in zip(range(rank, len(order)), blocks, strict=True):
        block_size[dimension] = levels[order.index(level)].denseSize
    dense = np.zeros(shape, values.dtype)

    def walk(level: int, position: int, index: list[int]) -> Iterator[tuple[int, list[int]]]:
        if level == len(levels):
            yield position, index
            return
        metadata = levels[level]
        if metadata.format == tfl.DimensionType.DENSE:
            for i in range(metadata.denseSize):
                yield from walk(level + 1, position * metadata.denseSize + i, [*index, i])
        else:
            segments, indices = metadata.arraySegments.values, metadata.arrayIndices.values
            for i in range(segments[position], segments[position + 1]):
                yield from walk(level + 1, i, [*index, int(indices[i])])

    for position, index in walk(0, 0, []):
        where = [0] * rank
        for level, value in zip(order, index, strict=True):
            if level < rank:
                where[level] += value * block_size[level]
            else:
                where[blocks[level - rank]] += value
        dense[tuple(where)] = values[position]
    return dense


@dataclass
class Converter:
    """Writes one TensorFlow Lite graph (NHWC) as ONNX nodes (NCHW)."""

    model: Any
    outputs: dict[str, str]
    nodes: list[Any] = field(default_factory=list)
    weights: dict[str, Any] = field(default_factory=dict)
    constants: dict[int, np.ndarray] = field(default_factory=dict)
    padding: dict[int, tuple[int, list[int]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.graph = self.model.subgraphs[0]
        self.rows = {  # which tensors no longer lie as images, and so need no transposing
            t for t in range(len(self.graph.tensors)) if len(self.shape(t)) != 4
        }

    def name(self, tensor: int) -> str:
        return f"t{tensor}"

    def shape(self, tensor: int) -> list[int]:
        shape = self.graph.tensors[tensor].shape
        return [] if shape is None else [int(n) for n in shape]

    def constant(self, tensor: int) -> np.ndarray | None:
        """The value of a tensor that is known at conversion, else None."""
        if tensor not in self.constants:
            description = self.graph.tensors[tensor]
            data = self.model.buffers[description.buffer].data
            if data is None or not len(data):
                return None
            values = np.asarray(data, np.uint8).view(DTYPES[description.type])
            if description.sparsity is not None:
                self.constants[tensor] = densify(values, self.shape(tensor), description.sparsity)
            else:
                self.constants[tensor] = values.reshape(self.shape(tensor))
        return self.constants[tensor]

    def weight(self, tensor: int, axes: Sequence[int]) -> str:
        """Store a constant with its axes in ONNX order; return the single-precision name."""
        name = f"w{tensor}"
        if name not in self.weights:
            value = self.constant(tensor)
            assert value is not None, f"tensor {tensor} is not constant"
            value = np.ascontiguousarray(value.transpose(axes))
            self.weights[name] = numpy_helper.from_array(value, name)
            if value.dtype == np.float16:
                self.emit("Cast", [name], f"{name}_f32", to=TensorProto.FLOAT)
        return f"{name}_f32" if f"{name}_f32" in self.known else name

    @property
    def known(self) -> set[str]:
        return {output for node in self.nodes for output in node.output}

    def shape_constant(self, name: str, values: Sequence[int]) -> str:
        self.weights[name] = numpy_helper.from_array(np.array(values, np.int64), name)
        return name

    def emit(self, operator: str, inputs: Sequence[str], output: str, **attributes: Any) -> None:
        self.nodes.append(helper.make_node(operator, inputs, [output], **attributes))

    def activated(self, activation: int, output: int) -> tuple[str, Callable[[], None]]:
        """The name to write before the fused activation, and what appends the activation."""
        kind = ACTIVATIONS[activation]
        if kind == "NONE":
            return self.name(output), lambda: None
        raw = self.name(output) + "_raw"
        if kind == "RELU":
            return raw, lambda: self.emit("Relu", [raw], self.name(output))
        if kind == "RELU6":
            for bound, value in (("zero", 0.0), ("six", 6.0)):
                self.weights[bound] = numpy_helper.from_array(np.float32(value), bound)
            return raw, lambda: self.emit("Clip", [raw, "zero", "six"], self.name(output))
        raise NotImplementedError(f"activation {kind}")

    def pads(self, source: int, kernel: Sequence[int], options: Any) -> tuple[int, list[int]]:
        """The tensor to read and ONNX pads (top, left, bottom, right); takes in a PAD before."""
        if options.padding == tfl.Padding.VALID:
            return self.padding.get(source, (source, [0, 0, 0, 0]))
        before, after = [], []
        strides = (options.strideH, options.strideW)
        for size, extent, stride in zip(self.shape(source)[1:3], kernel, strides, strict=True):
            total = max((-(-size // stride) - 1) * stride + extent - size, 0)
            before.append(total // 2)
            after.append(total - total // 2)
        if source in self.padding:
            raise NotImplementedError("PAD in front of an operator that pads by itself")
        return source, before + after

    def convolve(self, operator: Any, depthwise: bool) -> None:
        options = operator.builtinOptions
        source, kernel, bias = operator.inputs
        extent = self.shape(kernel)[1:3]
        read, pads = self.pads(source, extent, options)
        raw, activate = self.activated(options.fusedActivationFunction, operator.outputs[0])
        # TensorFlow Lite: (out, h, w, in), depthwise (1, h, w, out). ONNX: (out, in/groups, h, w).
        weight = self.weight(kernel, (3, 0, 1, 2) if depthwise else (0, 3, 1, 2))
        self.emit(
            "Conv",
            [self.name(read), weight, self.weight(bias, (0,))],
            raw,
            kernel_shape=extent,
            pads=pads,
            strides=[options.strideH, options.strideW],
            dilations=[options.dilationHFactor, options.dilationWFactor],
            group=self.shape(source)[3] if depthwise else 1,
        )
        activate()

    def prelu(self, source: int, slope: int, target: int) -> None:
        """max(x, 0) - slope max(-x, 0), as two point-wise convolutions: exact, since one term is
        always zero, and twice as fast as ONNX Runtime's PRelu, which leaves the layout of its
        convolutions."""
        steepness = self.constant(slope)
        assert steepness is not None
        one = np.eye(steepness.size, dtype=np.float32)
        both, name = np.concatenate([one, -one]), self.name(target)
        joined = np.concatenate([one, -one * steepness.reshape(-1, 1)], axis=1)
        for part, values in (("both", both), ("joined", joined)):
            weight = f"{name}_{part}"
            self.weights[weight] = numpy_helper.from_array(values[:, :, None, None], weight)
        self.emit("Conv", [self.name(source), f"{name}_both"], f"{name}_signs")
        self.emit("Relu", [f"{name}_signs"], f"{name}_parts")
        self.emit("Conv", [f"{name}_parts", f"{name}_joined"], name)

    def convert(self, operator: Any) -> None:
        """Append the ONNX nodes of one operator."""
        code = self.model.operatorCodes[operator.opcodeIndex]
        kind = OPERATORS[max(code.builtinCode, code.deprecatedBuiltinCode)]
        options = operator.builtinOptions
        source, target = operator.inputs[0], operator.outputs[0]
        if kind in ("DENSIFY", "DEQUANTIZE"):
            # The value stays in half precision; `weight` adds the Cast.
            value = self.constant(source)
            assert value is not None, f"{kind} of a tensor that is not constant"
            self.constants[target] = value
        elif kind == "PAD":
            amounts = self.constant(operator.inputs[1])
            assert amounts is not None
            (n0, n1), (top, bottom), (left, right), (c0, c1) = amounts.tolist()
            if n0 or n1 or c0 or c1:  # zeros in new channels: no operator can take these in
                whole = [n0, c0, top, left, n1, c1, bottom, right]
                amount = self.shape_constant(f"pads{target}", whole)
                self.emit("Pad", [self.name(source), amount], self.name(target))
            else:
                self.padding[target] = source, [top, left, bottom, right]
        elif kind in ("CONV_2D", "DEPTHWISE_CONV_2D"):
            self.convolve(operator, kind.startswith("DEPTHWISE"))
        elif kind == "MAX_POOL_2D":
            kernel = [options.filterHeight, options.filterWidth]
            read, pads = self.pads(source, kernel, options)
            strides = [options.strideH, options.strideW]
            self.emit(
                "MaxPool",
                [self.name(read)],
                self.name(target),
                kernel_shape=kernel,
                pads=pads,
                strides=strides,
            )
        elif kind == "FULLY_CONNECTED":
            weight, bias = operator.inputs[1:]
            raw, activate = self.activated(options.fusedActivationFunction, target)
            rows = [self.name(source), self.weight(weight, (0, 1)), self.weight(bias, (0,))]
            self.emit("Gemm", rows, raw, transB=1)
            activate()
        elif kind == "MEAN":
            axes = self.constant(operator.inputs[1])
            if options.keepDims or axes is None or axes.tolist() != [1, 2]:
                raise NotImplementedError("MEAN of other axes than height and width")
            self.emit("ReduceMean", [self.name(source)], self.name(target), axes=[2, 3], keepdims=0)
        elif kind == "PRELU":
            self.prelu(source, operator.inputs[1], target)
        elif kind == "STRIDED_SLICE":
            begin, end, step = (self.constant(i) for i in operator.inputs[1:])
            masks = (options.beginMask, options.endMask, options.ellipsisMask)
            if any((*masks, options.newAxisMask, options.shrinkAxisMask)):
                raise NotImplementedError("STRIDED_SLICE with a mask")
            bounds = []
            for what, values in (("begin", begin), ("end", end), ("step", step)):
                assert values is not None
                order = [int(values[axis]) for axis in (0, 3, 1, 2)]
                bounds.append(self.shape_constant(f"{what}{target}", order))
            every = self.shape_constant("axes", [0, 1, 2, 3])
            inputs = [self.name(source), *bounds[:2], every, bounds[2]]
            self.emit("Slice", inputs, self.name(target))
        elif kind == "ADD":
            raw, activate = self.activated(options.fusedActivationFunction, target)
            self.emit("Add", [self.name(i) for i in operator.inputs], raw)
            activate()
        elif kind == "RESIZE_BILINEAR":
            transformation = "asymmetric"
            if options.alignCorners:
                transformation = "align_corners"
            elif options.halfPixelCenters:
                transformation = "half_pixel"
            n, height, width, channels = self.shape(target)
            size = self.shape_constant(f"size{target}", [n, channels, height, width])
            self.emit(
                "Resize",
                [self.name(source), "", "", size],
                self.name(target),
                mode="linear",
                coordinate_transformation_mode=transformation,
            )
        elif kind == "DEPTH_TO_SPACE":
            self.emit(
                "DepthToSpace",
                [self.name(source)],
                self.name(target),
                blocksize=options.blockSize,
                mode="DCR",
            )
        elif kind == "LOGISTIC":
            self.emit("Sigmoid", [self.name(source)], self.name(target))
        elif kind == "RESHAPE":
            # The order of the values is that of NHWC.
            read = self.name(source)
            if source not in self.rows:
                self.emit("Transpose", [read], f"{read}_nhwc", perm=[0, 2, 3, 1])
                read += "_nhwc"
            size = self.shape_constant(f"shape{target}", self.shape(target))
            self.emit("Reshape", [read, size], self.name(target))
        elif kind == "CONCATENATION":
            if target not in self.rows:
                raise NotImplementedError("CONCATENATION of images")
            names = [self.name(i) for i in operator.inputs]
            self.emit("Concat", names, self.name(target), axis=options.axis)
        else:
            raise NotImplementedError(f"operator {kind}")

    def run(self) -> onnx.ModelProto:
        """The whole graph, from the image to the wanted outputs."""
        (image,) = self.graph.inputs
        self.emit("Transpose", ["image"], self.name(image), perm=[0, 3, 1, 2])
        for operator in self.graph.operators:
            self.convert(operator)
        results = []
        for tensor in self.graph.outputs:
            ours = self.outputs.get(self.graph.tensors[tensor].name.decode())
            if ours is None:
                continue
            if tensor in self.rows:
                self.emit("Identity", [self.name(tensor)], ours)
            else:
                self.emit("Transpose", [self.name(tensor)], ours, perm=[0, 2, 3, 1])
            results.append(
                helper.make_tensor_value_info(ours, TensorProto.FLOAT, self.shape(tensor))
            )
        needed = {result.name for result in results}
        nodes = []
        for node in reversed(self.nodes):  # leaves out what only a cut output needs
            if needed.intersection(node.output):
                needed.update(node.input)
                nodes.append(node)
        graph = helper.make_graph(
            nodes[::-1],
            "blazepose",
            [helper.make_tensor_value_info("image", TensorProto.FLOAT, self.shape(image))],
            results,
            [tensor for name, tensor in self.weights.items() if name in needed],
        )
        opsets = [helper.make_opsetid("", OPSET)]
        model = helper.make_model(graph, opset_imports=opsets, ir_version=8)
        model.producer_name = "actioncli"
        onnx.checker.check_model(model, full_check=True)
        return model


def to_onnx(original: bytes, outputs: dict[str, str]) -> bytes:
    """Convert a graph, keeping only the outputs that `outputs` renames; the input is `image`."""
    model = tfl.ModelT.InitFromPackedBuf(original, 0)
    return bytes(Converter(model, outputs).run().SerializeToString(deterministic=True))
