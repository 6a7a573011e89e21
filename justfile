# Sugar over plain cargo; the same words locally and in CI.

fmt-check:
    cargo fmt --all --check
lint:
    cargo clippy --workspace --all-targets --locked
deny:
    cargo deny check
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
