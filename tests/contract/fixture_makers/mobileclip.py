"""MobileCLIP-S0: the architecture of its package with few channels, exported by towers. Reference: that model with its branches as in
training, open_clip's tokenizer, and CLIPImageProcessor as the published preprocessor_config.json sets it.

The picture tower takes its real 256 pixels, the text tower its real 77 tokens.
"""

from __future__ import annotations

import gzip
import importlib.util
import sys
import tempfile
import types
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from contract_fixtures import OPEN_CLIP_TEXTS, digest, pictures, probe
from transformers import CLIPImageProcessor

from fixture_makers.common import save, seeded
from fixture_makers.tracing import trace
from fixture_makers.vocabulary import clip_tokenizer

SIDE_PX, CONTEXT, DIMENSION = 256, 77, 16


def make(folder: Path) -> None:
    """vision_model.onnx, text_model.onnx, tokenizer.json, reference.npz."""
    with tempfile.TemporaryDirectory() as scratch:
        vocabulary = clip_tokenizer(folder, Path(scratch))
        tokenizer = _open_clip_tokenizer(Path(scratch))
    package()
    model = seeded(lambda: _tiny(len(vocabulary)), 8)
    views = pictures()
    processor = CLIPImageProcessor(
        size={"shortest_edge": SIDE_PX}, crop_size={"height": SIDE_PX, "width": SIDE_PX}, resample=2, do_normalize=False
    )
    pixels = processor(list(views.values()), return_tensors="pt")["pixel_values"]
    ids = tokenizer(list(OPEN_CLIP_TEXTS), context_length=CONTEXT)
    with torch.no_grad():
        # Statistics of these pictures in the normalisations: with those they start with, all pictures look alike.
        for module in model.image_encoder.modules():
            if isinstance(module, torch.nn.BatchNorm2d):
                module.momentum = 1.0
        model.image_encoder.train()(pixels)
        model.eval()
        image_embeds, text_embeds, scale = model(pixels, ids)
    exported = _exportable(model)
    axis = {0: "batch_size"}
    free = {"pixel_values": {**axis, 1: "num_channels", 2: "height", 3: "width"}, "image_embeds": axis}
    trace(exported.image_encoder, {"pixel_values": pixels}, ["image_embeds"], free, folder / "vision_model.onnx")
    free = {"input_ids": axis, "text_embeds": axis}
    trace(exported.text_encoder, {"input_ids": ids}, ["text_embeds"], free, folder / "text_model.onnx")
    save(
        folder,
        **{f"probe_{name}": probe(value) for name, value in zip(views, pixels.numpy(), strict=True)},
        **{f"digest_{name}": np.array(digest(value)) for name, value in zip(views, pixels.numpy(), strict=True)},
        ids=ids.numpy(),
        image_embeds=image_embeds.numpy(),
        text_embeds=text_embeds.numpy(),
        logit_scale=scale.numpy(),
        logits_per_image=(scale * image_embeds @ text_embeds.T).numpy(),
    )


def package() -> None:
    """Makes mobileclip importable without timm and torchvision, of which it takes a few small parts."""
    layers = types.ModuleType("timm.models.layers")
    layers.DropPath = torch.nn.Identity
    layers.trunc_normal_ = torch.nn.init.trunc_normal_
    layers.SqueezeExcite = _SqueezeExcite
    models = types.ModuleType("timm.models")
    models.layers, models.register_model, models.create_model = layers, lambda function: function, None
    data = types.ModuleType("timm.data")
    data.IMAGENET_DEFAULT_MEAN = data.IMAGENET_DEFAULT_STD = None
    ops = types.ModuleType("torchvision.ops")
    ops.StochasticDepth = torch.nn.Identity
    transforms = types.ModuleType("torchvision.transforms")  # for a function that is not used here
    for name in ("CenterCrop", "Compose", "InterpolationMode", "Resize", "ToTensor"):
        setattr(transforms, name, None)
    stand_ins = [types.ModuleType(name) for name in ("timm", "torchvision", "open_clip")]
    stand_ins += [layers, models, data, ops, transforms]
    sys.modules.update({module.__name__: module for module in stand_ins})
    import mobileclip.clip  # noqa: F401

    for module in stand_ins:
        del sys.modules[module.__name__]  # transformers asks for them, too


class _SqueezeExcite(torch.nn.Module):
    """timm's (Apache-2.0), for the arguments that mobileclip gives."""

    def __init__(self, channels: int, rd_ratio: float) -> None:
        super().__init__()
        inner = max(8, int(channels * rd_ratio + 4) // 8 * 8)
        self.fc1, self.fc2 = torch.nn.Conv2d(channels, inner, 1), torch.nn.Conv2d(inner, channels, 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x * self.fc2(self.fc1(x.mean((2, 3), keepdim=True)).relu()).sigmoid()


def _tiny(pieces: int) -> torch.nn.Module:
    from mobileclip.clip import CLIP
    from mobileclip.image_encoder import MCi
    from mobileclip.models.mci import FastViT, RepCPE
    from mobileclip.text_encoder import TextTransformer

    class Tower(MCi):
        """MCi names one of its three sizes; this is mci0 with fewer blocks and channels."""

        def __init__(self) -> None:
            torch.nn.Module.__init__(self)
            cpe = partial(RepCPE, spatial_shape=(7, 7))
            mixers = ("repmixer", "repmixer", "repmixer", "attention")
            self.model = FastViT(
                [1, 1, 1, 1], mixers, [8, 8, 16, 32], [1, 1, 1, 1], [True] * 4, [False, False, True, True],
                pos_embs=[None, None, None, cpe], num_classes=1000,
            )  # fmt: skip
            self.model.head = MCi._update_image_classifier(self.model.head, DIMENSION)

    class Tiny(CLIP):
        def __init__(self) -> None:
            torch.nn.Module.__init__(self)
            text = {"context_length": CONTEXT, "vocab_size": pieces, "dim": 16, "ffn_multiplier_per_layer": 2.0}
            text |= {"n_heads_per_layer": 2, "n_transformer_layers": 2, "norm_layer": "layer_norm_fp32"}
            text |= {"causal_masking": False, "model_name": "mct"}
            self.output_dict, self.image_encoder = False, Tower()
            self.text_encoder = TextTransformer(text, DIMENSION)
            torch.nn.init.normal_(self.text_encoder.projection_layer)
            self.logit_scale = torch.nn.Parameter(torch.tensor(4.6))

    return Tiny()


def _exportable(model: torch.nn.Module) -> torch.nn.Module:
    """A copy with the branches of training folded, as its publishers did, and the pooling over a whole field written as a mean."""
    from mobileclip.modules.common import mobileone

    mobileone.F = types.SimpleNamespace(**vars(torch.nn.functional))
    mobileone.F.avg_pool2d = lambda inputs, kernel_size: inputs.mean((2, 3), keepdim=True)
    return mobileone.reparameterize_model(model)


def _open_clip_tokenizer(folder: Path) -> Any:
    """open_clip's tokenizer, another implementation, with the merges that are in the folder."""
    packed = folder / "merges.gz"
    packed.write_bytes(gzip.compress((folder / "merges.txt").read_bytes().rstrip(b"\n")))
    root = importlib.util.find_spec("open_clip").submodule_search_locations[0]
    spec = importlib.util.spec_from_file_location("open_clip_tokenizer", Path(root) / "tokenizer.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.SimpleTokenizer(str(packed))
