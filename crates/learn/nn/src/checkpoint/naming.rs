//! Names of weights in other conventions: wrappers of training checkpoints, and the naming of diffusers and transformers.

use std::collections::BTreeMap;

use super::View;
use super::error::CheckpointError;

/// Components that wrappers of training put anywhere into a name.
const WRAPPERS: [&str; 3] = ["_fsdp_wrapped_module", "_checkpoint_wrapped_module", "_orig_mod"];
/// Components that wrappers put in front of a name.
const FRONTS: [&str; 5] = ["module", "model", "state_dict", "diffusion_model", "vision_model"];
/// The networks of a training checkpoint, in the order in which one is chosen.
const PARTS: [&str; 2] = ["generator_ema", "generator"];

/// Residual blocks of a stage of the published autoencoders' encoder; their decoder has one more.
const ENCODER_BLOCKS: usize = 2;
const DECODER_BLOCKS: usize = ENCODER_BLOCKS + 1;

/// Which network the names belong to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Naming {
    /// Names as declared, in every file.
    Plain,
    /// Wan's transformer, or the one of diffusers.
    Transformer,
    /// Wan2.1's autoencoder, or the one of diffusers.
    Vae21,
    /// Wan2.2's autoencoder, or the one of diffusers.
    Vae22,
    /// The UMT5 encoder as Wan ships it, or the one of transformers.
    Umt5,
    /// The image half of CLIP as Wan ships it, or the one of transformers.
    Clip,
}

impl Naming {
    /// Says whether a file's names are those of diffusers or transformers.
    pub(super) fn is_foreign(self, views: &BTreeMap<String, View>) -> bool {
        let mark = match self {
            Self::Plain => return false,
            Self::Transformer => "condition_embedder.",
            Self::Vae21 | Self::Vae22 => "encoder.conv_in.",
            Self::Umt5 => "encoder.block.",
            Self::Clip => "embeddings.",
        };
        views.keys().any(|name| name.starts_with(mark))
    }

    /// Says whether a weight of the file may be left over.
    pub(super) fn ignores(self, name: &str) -> bool {
        match self {
            Self::Plain | Self::Vae21 | Self::Vae22 => false,
            Self::Transformer => name.contains(".norm_added_q."),
            Self::Umt5 => name == "encoder.embed_tokens.weight",
            Self::Clip => {
                let text = ["textual.", "text_model.", "text_projection.", "visual_projection."];
                text.iter().any(|front| name.starts_with(front))
                    || matches!(name, "log_scale" | "logit_scale" | "visual.head")
                    || name.ends_with("position_ids")
            }
        }
    }

    /// Returns the foreign names of a declared weight; several are put one after another along the first axis.
    pub(super) fn foreign(self, name: &str) -> Vec<String> {
        match self {
            Self::Plain => vec![name.to_owned()],
            Self::Transformer => vec![transformer(name)],
            Self::Vae21 | Self::Vae22 => vec![autoencoder(name, self == Self::Vae22)],
            Self::Umt5 => vec![umt5(name)],
            Self::Clip => clip(name),
        }
    }
}

/// Replaces the first entry of a table whose left side the text begins with.
fn replaced(text: &str, table: &[(&str, &str)]) -> Option<String> {
    table.iter().find_map(|(from, to)| Some(format!("{to}{}", text.strip_prefix(from)?)))
}

fn transformer(name: &str) -> String {
    const OUTSIDE: &[(&str, &str)] = &[
        ("text_embedding.0.", "condition_embedder.text_embedder.linear_1."),
        ("text_embedding.2.", "condition_embedder.text_embedder.linear_2."),
        ("time_embedding.0.", "condition_embedder.time_embedder.linear_1."),
        ("time_embedding.2.", "condition_embedder.time_embedder.linear_2."),
        ("time_projection.1.", "condition_embedder.time_proj."),
        ("img_emb.proj.0.", "condition_embedder.image_embedder.norm1."),
        ("img_emb.proj.1.", "condition_embedder.image_embedder.ff.net.0.proj."),
        ("img_emb.proj.3.", "condition_embedder.image_embedder.ff.net.2."),
        ("img_emb.proj.4.", "condition_embedder.image_embedder.norm2."),
        ("head.head.", "proj_out."),
        ("head.modulation", "scale_shift_table"),
    ];
    const INSIDE: &[(&str, &str)] = &[
        ("modulation", "scale_shift_table"),
        ("norm3.", "norm2."),
        ("ffn.0.", "ffn.net.0.proj."),
        ("ffn.2.", "ffn.net.2."),
        ("self_attn.", "attn1."),
        ("cross_attn.", "attn2."),
    ];
    const ATTENTION: &[(&str, &str)] = &[
        ("q.", "to_q."),
        ("k.", "to_k."),
        ("v.", "to_v."),
        ("o.", "to_out.0."),
        ("k_img.", "add_k_proj."),
        ("v_img.", "add_v_proj."),
        ("norm_k_img.", "norm_added_k."),
    ];
    let Some((layer, part)) = name.strip_prefix("blocks.").and_then(|rest| rest.split_once('.')) else {
        return replaced(name, OUTSIDE).unwrap_or_else(|| name.to_owned());
    };
    let part = replaced(part, INSIDE).unwrap_or_else(|| part.to_owned());
    let part = match part.split_once('.') {
        Some((attention @ ("attn1" | "attn2"), rest)) => {
            format!("{attention}.{}", replaced(rest, ATTENTION).unwrap_or_else(|| rest.to_owned()))
        }
        _ => part,
    };
    format!("blocks.{layer}.{part}")
}

fn autoencoder(name: &str, nested: bool) -> String {
    const OUTSIDE: &[(&str, &str)] = &[("conv1.", "quant_conv."), ("conv2.", "post_quant_conv.")];
    const INSIDE: &[(&str, &str)] = &[
        ("conv1.", "conv_in."),
        ("middle.0.", "mid_block.resnets.0."),
        ("middle.1.", "mid_block.attentions.0."),
        ("middle.2.", "mid_block.resnets.1."),
        ("head.0.", "norm_out."),
        ("head.2.", "conv_out."),
    ];
    if let Some(name) = replaced(name, OUTSIDE) {
        return name;
    }
    let Some((half, rest)) = name.split_once('.') else { return name.to_owned() };
    let rest = replaced(rest, INSIDE).or_else(|| stage(rest, nested)).unwrap_or_else(|| rest.to_owned());
    format!("{half}.{}", residual(&rest))
}

/// Renames the layers of a residual block.
fn residual(name: &str) -> String {
    const LAYERS: [(&str, &str); 5] = [
        (".residual.0.", ".norm1."),
        (".residual.2.", ".conv1."),
        (".residual.3.", ".norm2."),
        (".residual.6.", ".conv2."),
        (".shortcut.", ".conv_shortcut."),
    ];
    LAYERS.iter().fold(name.to_owned(), |name, (from, to)| name.replace(from, to))
}

/// Renames the position of a block among those of its half: Wan2.1 counts through, Wan2.2 by stage.
fn stage(name: &str, nested: bool) -> Option<String> {
    let (list, rest) = name.split_once('.')?;
    let (first, rest) = rest.split_once('.')?;
    let first: usize = first.parse().ok()?;
    let up = list == "upsamples";
    if !nested {
        let (stage, block) = (first / (DECODER_BLOCKS + 1), first % (DECODER_BLOCKS + 1));
        return Some(match (up, block) {
            (false, _) => format!("down_blocks.{first}.{rest}"),
            (true, DECODER_BLOCKS) => format!("up_blocks.{stage}.upsamplers.0.{rest}"),
            (true, block) => format!("up_blocks.{stage}.resnets.{block}.{rest}"),
        });
    }
    let (block, rest) = rest.strip_prefix(list)?.strip_prefix('.')?.split_once('.')?;
    let block: usize = block.parse().ok()?;
    Some(match (up, block) {
        (false, ENCODER_BLOCKS) => format!("down_blocks.{first}.downsampler.{rest}"),
        (false, _) => format!("down_blocks.{first}.resnets.{block}.{rest}"),
        (true, DECODER_BLOCKS) => format!("up_blocks.{first}.upsampler.{rest}"),
        (true, _) => format!("up_blocks.{first}.resnets.{block}.{rest}"),
    })
}

fn umt5(name: &str) -> String {
    const OUTSIDE: &[(&str, &str)] = &[("token_embedding.", "shared."), ("norm.", "encoder.final_layer_norm.")];
    const INSIDE: &[(&str, &str)] = &[
        ("norm1.", "layer.0.layer_norm."),
        ("norm2.", "layer.1.layer_norm."),
        ("attn.", "layer.0.SelfAttention."),
        ("ffn.gate.0.", "layer.1.DenseReluDense.wi_0."),
        ("ffn.fc1.", "layer.1.DenseReluDense.wi_1."),
        ("ffn.fc2.", "layer.1.DenseReluDense.wo."),
        ("pos_embedding.embedding.", "layer.0.SelfAttention.relative_attention_bias."),
    ];
    match name.strip_prefix("blocks.").and_then(|rest| rest.split_once('.')) {
        Some((layer, part)) => {
            format!("encoder.block.{layer}.{}", replaced(part, INSIDE).unwrap_or_else(|| part.to_owned()))
        }
        None => replaced(name, OUTSIDE).unwrap_or_else(|| name.to_owned()),
    }
}

fn clip(name: &str) -> Vec<String> {
    const OUTSIDE: &[(&str, &str)] = &[
        ("visual.patch_embedding.", "embeddings.patch_embedding."),
        ("visual.cls_embedding", "embeddings.class_embedding"),
        ("visual.pos_embedding", "embeddings.position_embedding.weight"),
        ("visual.pre_norm.", "pre_layrnorm."),
        ("visual.post_norm.", "post_layernorm."),
    ];
    const INSIDE: &[(&str, &str)] = &[
        ("norm1.", "layer_norm1."),
        ("norm2.", "layer_norm2."),
        ("attn.proj.", "self_attn.out_proj."),
        ("mlp.0.", "mlp.fc1."),
        ("mlp.2.", "mlp.fc2."),
    ];
    let Some((layer, part)) = name.strip_prefix("visual.transformer.").and_then(|rest| rest.split_once('.')) else {
        return vec![replaced(name, OUTSIDE).unwrap_or_else(|| name.to_owned())];
    };
    match part.strip_prefix("attn.to_qkv.") {
        Some(kind) => {
            ["q", "k", "v"].map(|part| format!("encoder.layers.{layer}.self_attn.{part}_proj.{kind}")).to_vec()
        }
        None => {
            let part = replaced(part, INSIDE).unwrap_or_else(|| part.to_owned());
            vec![format!("encoder.layers.{layer}.{part}")]
        }
    }
}

/// Takes wrappers off all names and keeps one network of a training checkpoint.
pub(super) fn unwrapped(
    views: BTreeMap<String, View>,
    part: Option<&str>,
) -> Result<BTreeMap<String, View>, CheckpointError> {
    let belongs = |name: &str, part: &str| name.strip_prefix(part).is_some_and(|rest| rest.starts_with('.'));
    let has = |part: &&str| views.keys().any(|name| belongs(name, part));
    let part = part.or_else(|| PARTS.into_iter().find(has)).map(str::to_owned);
    let mut found: BTreeMap<String, (String, View)> = BTreeMap::new();
    for (full, view) in views {
        let rest = match &part {
            Some(part) if belongs(&full, part) => &full[part.len() + 1..],
            Some(_) => continue,
            None => &full,
        };
        let kept = rest.split('.').filter(|component| !WRAPPERS.contains(component));
        let kept: Vec<&str> = kept.skip_while(|component| FRONTS.contains(component)).collect();
        let name = kept.join(".");
        if let Some((first, _)) = found.insert(name.clone(), (full.clone(), view)) {
            return Err(CheckpointError::Ambiguous { first, second: full, name });
        }
    }
    Ok(found.into_iter().map(|(name, (_, view))| (name, view)).collect())
}
