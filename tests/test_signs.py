"""What a match shows at each vertex without knowing the truth."""

import numpy as np

from skfmap.learner.signs import vertex_signs


def test_signs_grow_where_a_match_is_wrong(fitted, probed):
    matcher, shape = fitted.matcher_, probed[5]
    match, _ = matcher.match_points(shape, matcher.solve(shape).C)
    wrong = match.p2p.copy()
    wrong[:100] = np.random.default_rng(0).permutation(wrong[:100])
    right_signs, wrong_signs = (
        vertex_signs(matcher, shape, match._replace(p2p=p2p), refined=False)
        for p2p in (match.p2p, wrong)
    )
    assert right_signs.shape == (shape.spectral.mesh.n_vertices, 6)
    assert (wrong_signs[:100, :3].mean(axis=0) > right_signs[:100, :3].mean(axis=0) + 0.3).all()
    far = np.linalg.norm(
        shape.spectral.vertices - shape.spectral.vertices[:100].mean(axis=0), axis=1
    ).argmax()
    np.testing.assert_allclose(wrong_signs[far, :2], right_signs[far, :2])
