# Sugar over plain cargo; the same words locally and in CI.

fmt-check:
    cargo fmt --all --check
lint:
    cargo clippy --workspace --all-targets --locked -- -D warnings
deny:
    cargo deny --locked check
doc:
    RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked
test:
    cargo test --workspace --locked
test-slow:
    DREAMSTREAM_SLOW_TESTS=1 cargo test --workspace --locked
codegen:
    UPDATE_GENERATED=1 cargo test -p ds-wire --locked
codegen-check:
    cargo test -p ds-wire --locked
python-test:
    python3 -m venv .venv && .venv/bin/pip install -q './clients/python[test]' && .venv/bin/pytest clients/python
compose-smoke:
    OFFLINE=1 deploy/compose-smoke.sh
# The viewer beside the command line: rerun, for `view`, `--live` and `gap watch --connect`.
viewer:
    cargo build --locked -p dreamstream -p viewer
# The trainer beside it, for `data`, `train`, `video` and `study`.
trainer:
    cargo build --locked -p dreamstream -p trainer
# One wheel (command line and Python client) and one tarball, in target/packages.
packages:
    cargo build --locked -p dreamstream -p viewer -p trainer
    deploy/packages.sh
packages-smoke:
    deploy/packages-smoke.sh
# The weights that `video eval` compares the shipped ones with: hours (docs/training.md).
arms:
    #!/usr/bin/env bash
    set -euo pipefail
    train() { cargo run --locked -p trainer -- train "$@"; }
    arms=configs/models/arms
    mkdir -p $arms
    for set in broad narrow diverse test; do cargo run --locked -p trainer -- data render --config configs/data/$set.toml; done
    train all --config configs/train/cpu_train.toml
    for stage in prior teacher; do train ship --config configs/train/cpu_train.toml --of $stage --weights $arms/$stage.safetensors; done
    for arm in no_guidance standard_cfg; do train trajectories --config configs/train/arms/$arm.toml; done
    for arm in no_guidance standard_cfg clean_cache without_diverse; do
        for stage in ode self-forcing; do train $stage --config configs/train/arms/$arm.toml; done
        train ship --config configs/train/arms/$arm.toml --weights $arms/$arm.safetensors
    done
