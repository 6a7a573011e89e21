"""Generated from `proto/dreamstream_policy/v1/policy.proto` (see `clients/python/README.md`)."""
