//! The closed cavity: enclosed volume, its gradient (the load of a unit pressure) and its Hessian.
//!
//! The load derives from the potential `-p V(u)`, so force and tangent are exact derivatives and the tangent is
//! symmetric although the load follows the walls.

use crate::algebra::{Vec3, axpy, cross, dot, scale};
use crate::element::tri6;
use formats::mesh_file::TRI_FACETS;
use serde::{Deserialize, Serialize};

/// How the pressure on a 6-node face is passed to its nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CavityLoad {
    /// Four flat facets per face, a third of each facet's force per vertex, as the commercial solver's fluid cavity.
    #[default]
    FlatFacets,
    /// Consistent nodal forces of the quadratic surface.
    Consistent,
}

/// Enclosed volume of one oriented face, its gradient and Hessian: `d2V/dx_a dx_b = -[hessian_ab]x` (skew matrix).
#[derive(Clone, Debug, Default)]
pub(crate) struct FaceTerms {
    /// Volume of the cone from the origin to the face (mm3): only the sum over a closed surface has a meaning.
    pub(crate) volume_mm3: f64,
    /// Gradient with respect to the six nodes (mm2).
    pub(crate) gradient: [Vec3; 6],
    /// Axial vectors of the Hessian's blocks (mm), antisymmetric in (a, b).
    pub(crate) hessian: [[Vec3; 6]; 6],
}

/// Evaluates one face at deformed node positions `x`, oriented so that its normal points out of the cavity.
pub(crate) fn face_terms(x: &[Vec3; 6], load: CavityLoad) -> FaceTerms {
    match load {
        CavityLoad::FlatFacets => flat(x),
        CavityLoad::Consistent => consistent(x),
    }
}

fn flat(x: &[Vec3; 6]) -> FaceTerms {
    let mut out = FaceTerms::default();
    for [a, b, c] in TRI_FACETS {
        out.volume_mm3 += dot(x[a], cross(x[b], x[c])) / 6.0;
        for (i, j, k) in [(a, b, c), (b, c, a), (c, a, b)] {
            axpy(1.0 / 6.0, cross(x[j], x[k]), &mut out.gradient[i]);
            // d(x_j x x_k)/dx_j v = v x x_k = -[x_k]x v.
            axpy(1.0 / 6.0, x[k], &mut out.hessian[i][j]);
            axpy(-1.0 / 6.0, x[j], &mut out.hessian[i][k]);
        }
    }
    out
}

fn consistent(x: &[Vec3; 6]) -> FaceTerms {
    let mut out = FaceTerms::default();
    for [r, s, w] in tri6::SIX_POINTS {
        let (n, d) = (tri6::shape(r, s), tri6::derivatives(r, s));
        let (mut p, mut pr, mut ps) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        for a in 0..6 {
            axpy(n[a], x[a], &mut p);
            axpy(d[a][0], x[a], &mut pr);
            axpy(d[a][1], x[a], &mut ps);
        }
        // The reference triangle has area 1/2 and the cone a third: w / 6.
        let w = w / 6.0;
        out.volume_mm3 += w * dot(p, cross(pr, ps));
        for a in 0..6 {
            axpy(w * n[a], cross(pr, ps), &mut out.gradient[a]);
            axpy(w * d[a][0], cross(ps, p), &mut out.gradient[a]);
            axpy(w * d[a][1], cross(p, pr), &mut out.gradient[a]);
            for b in 0..6 {
                let mut y = scale(n[a] * d[b][0] - d[a][0] * n[b], ps);
                axpy(-(n[a] * d[b][1] - d[a][1] * n[b]), pr, &mut y);
                axpy(d[a][0] * d[b][1] - d[b][0] * d[a][1], p, &mut y);
                axpy(w, y, &mut out.hessian[a][b]);
            }
        }
    }
    out
}
