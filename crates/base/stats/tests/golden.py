"""Writes frechet.json with scipy's matrix square root, more than twice as many rows as features: python crates/base/stats/tests/golden.py > crates/base/stats/tests/frechet.json"""

import json

import numpy as np
from scipy.linalg import sqrtm

rows = []
for seed, (n, m, d) in enumerate([(12, 9, 2), (40, 30, 4), (25, 60, 5)]):
    r = np.random.default_rng(seed)
    a = np.round(r.normal(size=(n, d)) @ r.normal(size=(d, d)), 3)
    b = np.round(r.normal(size=(m, d)) @ r.normal(size=(d, d)) + r.normal(size=d), 3)
    ca, cb = np.cov(a.T), np.cov(b.T)
    value = float(((a.mean(0) - b.mean(0)) ** 2).sum() + np.trace(ca + cb - 2 * sqrtm(ca @ cb).real))
    rows.append(dict(a=a.tolist(), b=b.tolist(), value=value))
print(json.dumps(rows))
