//! The energy model: what the drives' work has become, linear in the same standard parameters as the torque.
//!
//! ```text
//! ∫ τᵀq̇ dt = [e(q, q̇) − e(q₀, q̇₀) + ∫ p(q̇) dt]ᵀ·x            Gautier & Khalil 1989; Schmidt & Pruefer, eq. 17
//! ```
//!
//! with e the kinetic and potential energy of each parameter and p the power that friction takes: for any motion
//! `d/dt e + p = q̇ᵀY(q, q̇, q̈)`, and no acceleration is needed. Columns that depend on others in Y do so here as well,
//! in differences of e: base parameters are the same.

use crate::arm::Arm;
use crate::link::LINK_PARAMETERS;
use crate::model::{Model, friction_sign};
use crate::rigid::Workspace;
use crate::spatial::{Vec3, add, cross, dot, rotate_back, scale};

impl Model {
    /// Energy e(q, q̇) of every standard parameter, [`len`](Model::len) entries written to `e`. Only differences mean
    /// something: potential energy is counted from the root link's origin. Real-time safe.
    ///
    /// Link `[m, h, I]` with v, ω of its frame and g, in that frame, and r from the root's origin:
    /// `½m·v² + h·(v×ω) + ½ωᵀIω − m·g·r − g·h`. Drives: `½Ia·q̇²`, `offset·q`, `Iam·q̇a·q̇b`; friction stores nothing.
    pub fn energy(&self, ws: &Workspace, q: &[f64], qd: &[f64], e: &mut [f64]) {
        let dof = self.arm.dof();
        link_energies(&self.arm, ws, q, qd, &mut e[..LINK_PARAMETERS * dof]);
        let drives = &mut e[LINK_PARAMETERS * dof..];
        drives.fill(0.0);
        for j in 0..dof {
            drives[j] = 0.5 * qd[j] * qd[j];
            if self.structure.offset {
                drives[3 * dof + j] = q[j];
            }
        }
        if let Some(coupling) = self.structure.coupling {
            let at = drives.len() - 3;
            drives[at] = qd[coupling.driving] * qd[coupling.driven];
        }
    }

    /// Power p(q̇) that friction takes for every standard parameter \[W a unit of the parameter\], zero for all that is
    /// not friction. Real-time safe.
    pub fn dissipation(&self, qd: &[f64], p: &mut [f64]) {
        let (dof, v0) = (self.arm.dof(), self.structure.sign_velocity);
        p.fill(0.0);
        let drives = &mut p[LINK_PARAMETERS * dof..];
        for j in 0..dof {
            drives[dof + j] = qd[j] * qd[j];
            drives[2 * dof + j] = qd[j] * friction_sign(qd[j], v0);
        }
        if let Some(coupling) = self.structure.coupling {
            let (a, b) = (qd[coupling.driving], qd[coupling.driven]);
            let at = drives.len() - 2;
            drives[at] = 2.0 * a * b;
            drives[at + 1] = (a + b) * friction_sign(a + b, v0);
        }
    }
}

fn link_energies(arm: &Arm, ws: &Workspace, q: &[f64], qd: &[f64], e: &mut [f64]) {
    let zero: Vec3 = [0.0; 3];
    // Of the link at hand, in its own frame: angular velocity, velocity of the origin, gravity; and g·r of the origin.
    let (mut w, mut v, mut g, mut drop) = (zero, zero, arm.gravity, 0.0);
    for (j, out) in e.chunks_exact_mut(LINK_PARAMETERS).enumerate() {
        let joint = ws.joint(j);
        let (r, p) = joint.pose(q[j]);
        drop += dot(&g, &p);
        let at_p = add(&v, &cross(&w, &p));
        w = add(&rotate_back(&r, &w), &scale(&joint.turn, qd[j]));
        v = add(&rotate_back(&r, &at_p), &scale(&joint.slide, qd[j]));
        g = rotate_back(&r, &g);
        let swing = cross(&v, &w);
        let [x, y, z] = w;
        out.copy_from_slice(&[
            0.5 * dot(&v, &v) - drop,
            swing[0] - g[0],
            swing[1] - g[1],
            swing[2] - g[2],
            0.5 * x * x,
            x * y,
            0.5 * y * y,
            x * z,
            y * z,
            0.5 * z * z,
        ]);
    }
}
