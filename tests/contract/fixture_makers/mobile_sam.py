"""MobileSAM: the architecture of the package mobilesam-mirror (Apache-2.0) with few channels, exported as its repository does it and
as the public files of Acly/MobileSAM were, and its SamPredictor as the reference.

The encoder's grid of 64 x 64 is written into TinyViT: pictures are 1024 pixels here, too.
"""

from __future__ import annotations

import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import torch
from contract_fixtures import BOXES, POINTS, pictures
from PIL import Image

from fixture_makers.common import save, seeded
from fixture_makers.tracing import trace

WIDTH = 16
_SIDE_PX, _GRID = 1024, 64
_PROMPT = ("image_embeddings", "point_coords", "point_labels", "mask_input", "has_mask_input", "orig_im_size")


def make(folder: Path) -> None:
    """encoder.onnx (``images``), encoder_bytes.onnx (``input_image``), decoder_single.onnx, decoder_multi.onnx, reference.npz."""
    mobile_sam = package()
    model = seeded(lambda: _tiny(mobile_sam), seed=11)
    with torch.no_grad():  # masks that depend on the prompt, and not always the same one best
        for weight in model.mask_decoder.parameters():
            weight.mul_(2 if weight.dim() > 1 else 1)
    trace(
        model.image_encoder, {"images": torch.randn(1, 3, _SIDE_PX, _SIDE_PX)}, ["image_embeddings"], {},
        folder / "encoder.onnx",
    )  # fmt: skip
    free = {"input_image": {0: "image_height", 1: "image_width"}}
    bytes_in = {"input_image": torch.rand(700, 1024, 3) * 255}
    trace(_Bytes(model), bytes_in, ["image_embeddings"], free, folder / "encoder_bytes.onnx")
    from mobile_sam.utils.onnx import SamOnnxModel

    for kind in ("single", "multi"):
        _export_decoder(SamOnnxModel(model, return_single_mask=kind == "single"), folder / f"decoder_{kind}.onnx")
    save(folder, **_reference(mobile_sam, model))


def _reference(mobile_sam: Any, model: torch.nn.Module) -> dict[str, np.ndarray]:
    """By box and by point: scores, and the best of three masks, one bit a pixel."""
    predictor = mobile_sam.SamPredictor(model)
    arrays = {}
    for name, view in pictures().items():
        if name not in BOXES:
            continue
        predictor.set_image(view)
        arrays[f"features_{name}"] = predictor.features.numpy()[..., ::4, ::4]
        prompts = {
            "box": [{"box": np.array(box)} for box in BOXES[name]],
            "point": [{"point_coords": np.array([p]), "point_labels": np.array([1])} for p in POINTS[name]],
        }
        for kind, each in prompts.items():
            found = [predictor.predict(**prompt, multimask_output=True) for prompt in each]
            arrays[f"{kind}_{name}_ious"] = np.stack([ious for _, ious, _ in found])
            arrays[f"{kind}_{name}_masks"] = np.packbits([masks[ious.argmax()] for masks, ious, _ in found])
    return arrays


def _tiny(mobile_sam: Any) -> torch.nn.Module:
    parts = mobile_sam.modeling
    encoder = parts.TinyViT(
        img_size=_SIDE_PX, num_classes=0, embed_dims=[8, 8, 16, 16], depths=[1, 1, 1, 1], num_heads=[1, 1, 2, 2],
        window_sizes=[7, 7, 7, 7], mlp_ratio=2.0, drop_path_rate=0.0, mbconv_expand_ratio=2.0,
    )  # fmt: skip
    encoder.layers[2].downsample.conv2.c.stride = (1, 1)  # as the package has it where the last width is 320
    norm = type(encoder.neck[1])  # the neck's 256 channels are written into the package: the same neck with fewer
    conv = torch.nn.Conv2d
    encoder.neck = torch.nn.Sequential(
        conv(16, WIDTH, 1, bias=False), norm(WIDTH), conv(WIDTH, WIDTH, 3, padding=1, bias=False), norm(WIDTH)
    )
    prompts = parts.PromptEncoder(WIDTH, (_GRID, _GRID), (_SIDE_PX, _SIDE_PX), mask_in_chans=4)
    transformer = parts.TwoWayTransformer(depth=1, embedding_dim=WIDTH, num_heads=2, mlp_dim=32)
    decoder = parts.MaskDecoder(
        transformer_dim=WIDTH, transformer=transformer, num_multimask_outputs=3, iou_head_hidden_dim=WIDTH
    )
    return parts.Sam(encoder, prompts, decoder)


class _Bytes(torch.nn.Module):
    """The public encoder file: normalises, then pads below and to the right, then encodes."""

    def __init__(self, model: torch.nn.Module) -> None:
        super().__init__()
        self.model = model

    def forward(self, input_image: torch.Tensor) -> torch.Tensor:
        pixels = input_image.permute(2, 0, 1)
        pixels = (pixels - self.model.pixel_mean) / self.model.pixel_std
        height, width = pixels.shape[-2:]
        return self.model.image_encoder(
            torch.nn.functional.pad(pixels, (0, _SIDE_PX - width, 0, _SIDE_PX - height))[None]
        )


def _export_decoder(module: torch.nn.Module, path: Path) -> None:
    points = torch.rand(1, 2, 2) * 900
    values = (
        torch.randn(1, WIDTH, _GRID, _GRID), points, torch.tensor([[2.0, 3.0]]), torch.randn(1, 1, 4 * _GRID, 4 * _GRID),
        torch.tensor([1.0]), torch.tensor([480.0, 640.0]),
    )  # fmt: skip
    dynamic = {"point_coords": {1: "num_points"}, "point_labels": {1: "num_points"}}
    names = ("masks", "iou_predictions", "low_res_masks")
    trace(module, dict(zip(_PROMPT, values, strict=True)), names, dynamic, path)


def package() -> Any:
    """mobile_sam without timm and torchvision, of which it takes a few small functions: an installed timm breaks transformers."""
    layers = types.ModuleType("timm.models.layers")
    layers.DropPath = torch.nn.Identity
    layers.to_2tuple = lambda value: (value, value)
    layers.trunc_normal_ = torch.nn.init.trunc_normal_
    registry = types.ModuleType("timm.models.registry")
    registry.register_model = lambda function: function
    functional = types.ModuleType("torchvision.transforms.functional")
    functional.to_pil_image = Image.fromarray
    functional.resize = lambda image, size: image.resize(size[::-1], Image.Resampling.BILINEAR)
    boxes = types.ModuleType("torchvision.ops.boxes")  # for a class that is not used here
    boxes.batched_nms = boxes.box_area = None
    for module in (layers, registry, functional, boxes):
        parts = module.__name__.split(".")
        for end in range(1, len(parts)):
            sys.modules.setdefault(".".join(parts[:end]), types.ModuleType(".".join(parts[:end])))
        sys.modules[module.__name__] = module
    import mobile_sam

    for name in [name for name in sys.modules if name.split(".")[0] in ("timm", "torchvision")]:
        del sys.modules[name]  # transformers asks for them, too
    return mobile_sam
