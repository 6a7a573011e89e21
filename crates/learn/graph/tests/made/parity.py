"""Builds small random networks with diffusers and transformers, and saves weights, inputs and outputs.

Usage: parity.py FOLDER. For each case there are CASE.safetensors (names of the library), CASE.native.safetensors (names
of the published checkpoints), and CASE.io.safetensors (inputs and outputs, channels last). transformer.pth is an archive of
torch.save with the wrappers of a training checkpoint.
"""

import re
import sys
from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors.torch import save_file

OUT = Path(sys.argv[1])
TOKENS = 512  # diffusers takes the last 512 context tokens for the prompt


def stir(module):
    """Moves every parameter away from its initial value, so that no part is idle."""
    generator = torch.Generator().manual_seed(7)
    for parameter in module.parameters():
        spread = 0.1 if parameter.dim() < 2 else 0.3 / parameter[0].numel() ** 0.5
        parameter.data += spread * torch.randn(parameter.shape, generator=generator)
    return module.eval()


def draw(*shape, seed=1, scale=1.0):
    return scale * torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def renamed(state, rules):
    out = {}
    for name, value in state.items():
        for pattern, replacement in rules:
            name = re.sub(pattern, replacement, name)
        assert name not in out, name
        out[name] = value
    return out


def save(case, state, native, tensors):
    plain = lambda table: {name: value.detach().clone().contiguous() for name, value in table.items()}
    save_file(plain(state), OUT / f"{case}.safetensors")
    save_file(plain(native), OUT / f"{case}.native.safetensors")
    save_file(plain(tensors), OUT / f"{case}.io.safetensors")
    print(case, "ok")


TRANSFORMER = [
    (r"^condition_embedder\.text_embedder\.linear_1", "text_embedding.0"),
    (r"^condition_embedder\.text_embedder\.linear_2", "text_embedding.2"),
    (r"^condition_embedder\.time_embedder\.linear_1", "time_embedding.0"),
    (r"^condition_embedder\.time_embedder\.linear_2", "time_embedding.2"),
    (r"^condition_embedder\.time_proj", "time_projection.1"),
    (r"^condition_embedder\.image_embedder\.norm1", "img_emb.proj.0"),
    (r"^condition_embedder\.image_embedder\.ff\.net\.0\.proj", "img_emb.proj.1"),
    (r"^condition_embedder\.image_embedder\.ff\.net\.2", "img_emb.proj.3"),
    (r"^condition_embedder\.image_embedder\.norm2", "img_emb.proj.4"),
    (r"^scale_shift_table", "head.modulation"),
    (r"scale_shift_table", "modulation"),
    (r"^proj_out", "head.head"),
    (r"\.norm2\.", ".norm3."),
    (r"ffn\.net\.0\.proj", "ffn.0"),
    (r"ffn\.net\.2", "ffn.2"),
    (r"attn1\.", "self_attn."),
    (r"attn2\.", "cross_attn."),
    (r"\.to_([qkv])\.", r".\1."),
    (r"\.to_out\.0\.", ".o."),
    (r"\.add_([kv])_proj\.", r".\1_img."),
    (r"\.norm_added_k\.", ".norm_k_img."),
]


def tokens(x):
    """[1, C, F, H, W] to [F, H/2·W/2, 4, C]."""
    _, c, f, h, w = x.shape
    x = x.reshape(c, f, h // 2, 2, w // 2, 2).permute(1, 2, 4, 3, 5, 0)
    return x.reshape(f, h * w // 4, 4, c)


def transformer(case, channels, image, times):
    from diffusers import WanTransformer3DModel
    from diffusers.loaders.single_file_utils import convert_wan_transformer_to_diffusers

    torch.manual_seed(3)
    more = {"image_dim": 40, "added_kv_proj_dim": 64} if image else {}
    model = WanTransformer3DModel(
        num_attention_heads=2, attention_head_dim=32, in_channels=channels, out_channels=16, text_dim=24,
        ffn_dim=96, num_layers=2, **more,
    )
    stir(model)
    state = model.state_dict()
    native = renamed(state, TRANSFORMER)
    # The library's own conversion of published names must give back its names.
    assert convert_wan_transformer_to_diffusers(dict(native)).keys() == state.keys()
    x = draw(1, channels, 3, 6, 8)
    text = draw(1, TOKENS, 24, seed=2)
    states = draw(1, 17, 40, seed=3) if image else None
    timestep = torch.tensor(times) if len(times) == 1 else torch.tensor(times).repeat_interleave(12)[None]
    with torch.no_grad():
        output = model(x, timestep, text, encoder_hidden_states_image=states, return_dict=False)[0]
    tensors = {"x": tokens(x), "text": text, "times": torch.tensor(times), "output": tokens(output)}
    if image:
        tensors["states"] = states
    save(case, state, native, tensors)
    return native


AUTOENCODER = [
    (r"^quant_conv", "conv1"),
    (r"^post_quant_conv", "conv2"),
    (r"conv_in", "conv1"),
    (r"norm_out", "head.0"),
    (r"conv_out", "head.2"),
    (r"mid_block\.resnets\.0", "middle.0"),
    (r"mid_block\.attentions\.0", "middle.1"),
    (r"mid_block\.resnets\.1", "middle.2"),
    (r"\.norm1\.", ".residual.0."),
    (r"\.norm2\.", ".residual.3."),
    (r"(downsamples|upsamples|down_blocks|up_blocks|middle|resnets)(.*)\.conv1\.", r"\1\2.residual.2."),
    (r"\.conv2\.(weight|bias)$", r".residual.6.\1"),
    (r"\.conv_shortcut\.", ".shortcut."),
]


def autoencoder(case, folded):
    from diffusers import AutoencoderKLWan
    from diffusers.loaders.single_file_utils import convert_wan_vae_to_diffusers

    torch.manual_seed(4)
    if folded:
        model = AutoencoderKLWan(
            base_dim=8, decoder_base_dim=12, z_dim=6, is_residual=True, patch_size=2, in_channels=12,
            out_channels=12, latents_mean=[0.0] * 6, latents_std=[1.0] * 6, scale_factor_spatial=16,
        )
    else:
        model = AutoencoderKLWan(base_dim=8, z_dim=4, latents_mean=[0.0] * 4, latents_std=[1.0] * 4)
    stir(model)
    state = model.state_dict()
    native = renamed(state, AUTOENCODER)
    if folded:
        native = renamed(native, [
            (r"down_blocks\.(\d)\.resnets\.(\d)", r"downsamples.\1.downsamples.\2"),
            (r"down_blocks\.(\d)\.downsampler", r"downsamples.\1.downsamples.2"),
            (r"up_blocks\.(\d)\.resnets\.(\d)", r"upsamples.\1.upsamples.\2"),
            (r"up_blocks\.(\d)\.upsampler", r"upsamples.\1.upsamples.3"),
        ])
    else:
        def flat(name):
            name = name.replace("down_blocks", "downsamples")
            place = lambda match: f"upsamples.{4 * int(match[1]) + int(match[2])}"
            name = re.sub(r"up_blocks\.(\d)\.resnets\.(\d)", place, name)
            return re.sub(r"up_blocks\.(\d)\.upsamplers\.0", lambda match: f"upsamples.{4 * int(match[1]) + 3}", name)

        native = {flat(name): value for name, value in native.items()}
        converted = convert_wan_vae_to_diffusers(dict(native))
        assert converted.keys() == state.keys(), converted.keys() ^ state.keys()
    frames = draw(1, 3, 9, 64, 96, seed=5).clamp(-1, 1)
    with torch.no_grad():
        means = model.encode(frames).latent_dist.mode()
        latents = draw(*means.shape, seed=6)
        decoded = model.decode(latents, return_dict=False)[0]
    last = lambda x: x[0].permute(1, 2, 3, 0)
    save(case, state, native, {
        "frames": last(frames), "means": last(means), "latents": last(latents), "decoded": last(decoded),
    })


def umt5():
    from transformers import UMT5Config, UMT5EncoderModel

    torch.manual_seed(5)
    config = UMT5Config(
        vocab_size=100, d_model=32, d_kv=8, d_ff=48, num_layers=2, num_heads=4, feed_forward_proj="gated-gelu",
    )
    model = stir(UMT5EncoderModel(config))
    state = {name: value for name, value in model.state_dict().items() if name != "encoder.embed_tokens.weight"}
    native = renamed(state, [
        (r"^shared", "token_embedding"),
        (r"^encoder\.final_layer_norm", "norm"),
        (r"^encoder\.block\.(\d+)\.", r"blocks.\1."),
        (r"layer\.0\.SelfAttention\.relative_attention_bias", "pos_embedding.embedding"),
        (r"layer\.0\.SelfAttention", "attn"),
        (r"layer\.0\.layer_norm", "norm1"),
        (r"layer\.1\.layer_norm", "norm2"),
        (r"layer\.1\.DenseReluDense\.wi_0", "ffn.gate.0"),
        (r"layer\.1\.DenseReluDense\.wi_1", "ffn.fc1"),
        (r"layer\.1\.DenseReluDense\.wo", "ffn.fc2"),
    ])
    length, count = 220, 200
    ids = torch.randint(0, 100, (1, length), generator=torch.Generator().manual_seed(8))
    mask = (torch.arange(length) < count).long()[None]
    with torch.no_grad():
        states = model(ids, attention_mask=mask).last_hidden_state * mask[..., None]
    save("umt5", state, native, {"ids": ids[:, :count].float(), "states": states})


def clip():
    from transformers import CLIPVisionConfig, CLIPVisionModel

    torch.manual_seed(6)
    config = CLIPVisionConfig(
        hidden_size=64, intermediate_size=96, num_hidden_layers=3, num_attention_heads=4, image_size=56,
        patch_size=14, hidden_act="gelu", layer_norm_eps=1e-5,
    )
    model = stir(CLIPVisionModel(config))
    state = {name: value for name, value in model.state_dict().items() if "position_ids" not in name}
    native = renamed(state, [
        (r"^vision_model\.", ""),
        (r"^embeddings\.class_embedding", "cls_embedding"),
        (r"^embeddings\.position_embedding\.weight", "pos_embedding"),
        (r"^embeddings\.patch_embedding", "patch_embedding"),
        (r"^pre_layrnorm", "pre_norm"),
        (r"^post_layernorm", "post_norm"),
        (r"^encoder\.layers\.", "transformer."),
        (r"layer_norm([12])", r"norm\1"),
        (r"mlp\.fc1", "mlp.0"),
        (r"mlp\.fc2", "mlp.2"),
        (r"self_attn\.out_proj", "attn.proj"),
        (r"^", "visual."),
    ])
    native["visual.cls_embedding"] = native["visual.cls_embedding"].reshape(1, 1, 64)
    native["visual.pos_embedding"] = native["visual.pos_embedding"][None]
    native["visual.head"] = draw(64, 32)
    native["log_scale"] = torch.zeros(1)
    native["textual.token_embedding.weight"] = draw(10, 8)
    for layer in range(3):
        for kind in ["weight", "bias"]:
            name = f"visual.transformer.{layer}."
            parts = [native.pop(f"{name}self_attn.{part}_proj.{kind}") for part in "qkv"]
            native[f"{name}attn.to_qkv.{kind}"] = torch.cat(parts)
    image = torch.rand(1, 3, 40, 70, generator=torch.Generator().manual_seed(9))
    x = F.interpolate(image, size=(56, 56), mode="bicubic", align_corners=False)
    mean = torch.tensor([0.48145466, 0.4578275, 0.40821073]).reshape(1, 3, 1, 1)
    deviation = torch.tensor([0.26862954, 0.26130258, 0.27577711]).reshape(1, 3, 1, 1)
    with torch.no_grad():
        hidden = model((x - mean) / deviation, output_hidden_states=True).hidden_states
    assert len(hidden) == 4
    save("clip", state, native, {"image": image[0].permute(1, 2, 0), "states": hidden[-2]})


def tiny():
    """TAEW2.1 written out from its public description: memory blocks, pooling and growing in time."""
    from torch import nn

    torch.manual_seed(10)
    conv = lambda inputs, outputs, **more: nn.Conv2d(inputs, outputs, 3, padding=1, **more)

    class Memory(nn.Module):
        def __init__(self, width):
            super().__init__()
            relu = nn.ReLU()
            self.conv = nn.Sequential(
                conv(2 * width, width), relu, conv(width, width), relu, conv(width, width)
            )

        def forward(self, x):
            past = torch.cat([torch.zeros_like(x[:1]), x[:-1]])
            return F.relu(x + self.conv(torch.cat([x, past], 1)))

    class Pool(nn.Module):
        def __init__(self, width, frames):
            super().__init__()
            self.frames, self.conv = frames, nn.Conv2d(width * frames, width, 1, bias=False)

        def forward(self, x):
            return self.conv(x.reshape(-1, self.frames * x.shape[1], *x.shape[2:]))

    class Grow(nn.Module):
        def __init__(self, width, frames):
            super().__init__()
            self.conv = nn.Conv2d(width, width * frames, 1, bias=False)

        def forward(self, x):
            return self.conv(x).reshape(-1, x.shape[1], *x.shape[2:])

    class Clamp(nn.Module):
        def forward(self, x):
            return torch.tanh(x / 3) * 3

    def down(frames):
        return [Pool(64, frames), conv(64, 64, stride=2, bias=False), Memory(64), Memory(64), Memory(64)]

    def up(width, outputs, frames):
        blocks = [Memory(width), Memory(width), Memory(width)]
        return [*blocks, nn.Upsample(scale_factor=2), Grow(width, frames), conv(width, outputs, bias=False)]

    encoder = nn.Sequential(conv(3, 64), nn.ReLU(), *down(2), *down(2), *down(1), conv(64, 16))
    decoder = nn.Sequential(
        Clamp(), conv(16, 256), nn.ReLU(), *up(256, 128, 1), *up(128, 64, 2), *up(64, 64, 2), nn.ReLU(), conv(64, 3)
    )
    model = nn.ModuleDict({"encoder": encoder, "decoder": decoder}).eval()
    frames = torch.rand(8, 3, 32, 48, generator=torch.Generator().manual_seed(11))
    latents = draw(2, 16, 4, 6, seed=12)
    with torch.no_grad():
        for parameter in model.parameters():
            parameter *= 1.9 if parameter.dim() > 1 else 1.0
        # Around the middle of the range, so that the limits of the output hide little.
        decoder[-1].weight *= 0.15
        decoder[-1].bias += 0.5
        encoded, decoded = encoder(frames), decoder(latents).clamp(0, 1)
    last = lambda x: x.permute(0, 2, 3, 1)
    state = model.state_dict()
    save("tae", state, state, {
        "frames": last(frames), "encoded": last(encoded), "latents": last(latents), "decoded": last(decoded),
    })


TEXTS = [
    "A wet road at night, with two cars ahead.",
    "  many   spaces \n and lines ",
    "\uff21\uff42\uff43 \ufb01ne \u00bd caf\u00e9 na\u00efve \u2460",
    "\u591c\u306e\u9053\u8def\u3001\u96e8",
    "emoji \U0001f697 in between",
    "",
]


def tokens_of_text():
    import sentencepiece

    words = "road night rain snow fog car bus truck people walk cross light turn left right ahead behind wet dry".split()
    generator = torch.Generator().manual_seed(13)
    pick = lambda: " ".join(words[int(i)] for i in torch.randint(0, len(words), (7,), generator=generator))
    lines = [f"A {pick()}, and the {pick()}." for _ in range(400)] + [text for text in TEXTS[:3] if text.strip()] * 5
    tensors = {}
    for name, more in [("bytes", {"byte_fallback": True, "vocab_size": 460}), ("plain", {"vocab_size": 200})]:
        sentencepiece.SentencePieceTrainer.train(
            sentence_iterator=iter(line.replace("\n", " ") for line in lines), model_prefix=str(OUT / name), pad_id=0,
            eos_id=1, unk_id=2, bos_id=-1, normalization_rule_name="nmt_nfkc", minloglevel=2, hard_vocab_limit=False, **more,
        )
        model = sentencepiece.SentencePieceProcessor(model_file=str(OUT / f"{name}.model"))
        for index, text in enumerate(TEXTS):
            tensors[f"{name}.{index}"] = torch.tensor(model.encode(text) + [1]).float()
    save_file(tensors, OUT / "tokens.io.safetensors")
    print("tokens ok")


def main():
    OUT.mkdir(parents=True, exist_ok=True)
    native = transformer("text", 16, False, [937.5])
    wrapped = {f"model._fsdp_wrapped_module.{name}": value for name, value in native.items()}
    # One weight is saved through a transposed view, as torch.save keeps strides.
    some = "model._fsdp_wrapped_module.blocks.0.ffn.0.weight"
    wrapped[some] = wrapped[some].t().contiguous().t()
    torch.save({"generator": wrapped, "critic": {"head": torch.zeros(3)}, "step": 7}, OUT / "transformer.pth")
    transformer("control", 48, True, [625.0])
    transformer("frames", 16, False, [0.0, 833.0, 500.0])
    autoencoder("vae21", False)
    autoencoder("vae22", True)
    umt5()
    clip()
    tiny()
    tokens_of_text()


main()
