//! Rigid links plus drives: the model whose parameters are identified.

use crate::arm::{Arm, MAX_JOINTS};
use crate::effects::KnownEffects;
use crate::lanes::{Lanes, Pair};
use crate::link::{LINK_PARAMETERS, LinkParameters};
use crate::parameters::{Parameter, Places};
use crate::rigid::{State, Workspace, regressor_pair_rows, regressor_rows};
use crate::slip::{Slip, WristCoupling};

/// Which drive effects the model has.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Structure {
    /// A constant torque each joint.
    pub offset: bool,
    /// Three parameters of a coupled wrist.
    pub coupling: Option<WristCoupling>,
    /// v0 of `s(v) = tanh(v/v0)` \[rad/s\]; 0 is the hard sign.
    pub sign_velocity: f64,
    /// Travel \[rad\] in which Coulomb friction builds up after a reversal, with [`Model::regressor_sliding`]; 0 is
    /// friction without memory, `s(v)`.
    pub presliding_travel: f64,
    /// Coulomb friction in proportion to the torque that the gear carries.
    pub load_friction: bool,
    /// Friction with the square of the speed.
    pub viscous_quadratic: bool,
}

/// Values of the drive parameters, one entry a joint; what a URDF cannot say.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Joints {
    /// Drive inertia at the joint \[kg·m²\].
    pub rotor_inertia: Vec<f64>,
    /// \[N·m·s/rad\].
    pub viscous: Vec<f64>,
    /// \[N·m\].
    pub coulomb: Vec<f64>,
    /// \[N·m\]; read only with [`Structure::offset`].
    pub offset: Vec<f64>,
    /// Coulomb friction over carried torque \[-\]; read only with [`Structure::load_friction`].
    pub load_friction: Vec<f64>,
    /// \[N·m·s²/rad²\]; read only with [`Structure::viscous_quadratic`].
    pub viscous_quadratic: Vec<f64>,
    /// Inertia \[kg·m²\], viscous \[N·m·s/rad\] and Coulomb \[N·m\] of the coupled motor; read only with
    /// [`Structure::coupling`].
    pub coupling: [f64; 3],
}

impl Joints {
    /// `n` joints whose drives have nothing.
    #[must_use]
    pub fn zero(n: usize) -> Joints {
        let zeros = vec![0.0; n];
        Joints {
            rotor_inertia: zeros.clone(),
            viscous: zeros.clone(),
            coulomb: zeros.clone(),
            offset: zeros.clone(),
            load_friction: zeros.clone(),
            viscous_quadratic: zeros,
            coupling: [0.0; 3],
        }
    }
}

impl Slip {
    /// Friction of `model` that no motion has directed yet.
    #[must_use]
    pub fn new(model: &Model) -> Slip {
        Slip::undirected(model.arm.dof(), model.structure.presliding_travel, model.structure.coupling)
    }
}

/// The direction of friction: `tanh(v/v0)`, or for `v0 = 0` the sign of `v`, which is 0 at standstill.
#[inline]
pub fn friction_sign(v: f64, v0: f64) -> f64 {
    if v0 > 0.0 {
        Lanes::tanh(v / v0)
    } else if v == 0.0 {
        0.0
    } else {
        v.signum()
    }
}

/// An arm with its drives, linear in the standard parameter vector `x`: `τ = Y(q, q̇, q̈)·x`.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Geometry and nominal bodies.
    pub arm: Arm,
    /// Which drive effects there are.
    pub structure: Structure,
    /// Meaning of each entry of the standard vector, in order.
    pub parameters: Vec<Parameter>,
    /// Bodies whose torque is what the gears carry, for [`Structure::load_friction`]: those of the arm, until
    /// [`with_load`](Model::with_load) gives better ones. Part of what a load-friction parameter means.
    load: Vec<LinkParameters>,
    /// Standard deviations of the entries of the links' bodies that nobody knows; 0, or none, of those that are known.
    unknown: Vec<f64>,
    /// Effects of known size beside the regressor: its parameters are what is left of the torque without them.
    effects: KnownEffects,
}

impl Model {
    /// Lists the parameters of `arm` with the given structure.
    ///
    /// # Panics
    /// If a coupled joint does not exist or is coupled to itself; configurations are checked before.
    #[must_use]
    pub fn new(arm: Arm, structure: Structure) -> Model {
        let dof = arm.dof();
        if let Some(WristCoupling { driving, driven }) = structure.coupling {
            assert!(driving < dof && driven < dof && driving != driven, "coupling {driving}-{driven} of {dof} joints");
        }
        let links = (0..dof).flat_map(|link| (0..LINK_PARAMETERS).map(move |entry| Parameter::Link { link, entry }));
        let mut parameters: Vec<Parameter> = links.collect();
        parameters.extend((0..dof).map(Parameter::RotorInertia));
        parameters.extend((0..dof).map(Parameter::Viscous));
        parameters.extend((0..dof).map(Parameter::Coulomb));
        if structure.offset {
            parameters.extend((0..dof).map(Parameter::Offset));
        }
        if structure.load_friction {
            parameters.extend((0..dof).map(Parameter::LoadFriction));
        }
        if structure.viscous_quadratic {
            parameters.extend((0..dof).map(Parameter::ViscousQuadratic));
        }
        if structure.coupling.is_some() {
            use Parameter::{CouplingCoulomb, CouplingInertia, CouplingViscous};
            parameters.extend([CouplingInertia, CouplingViscous, CouplingCoulomb]);
        }
        let load = arm.links.clone();
        Model { arm, structure, parameters, load, unknown: Vec::new(), effects: KnownEffects::default() }
    }

    /// Places of the entries that every model has.
    pub fn places(&self) -> Places {
        Places::new(self.arm.dof())
    }

    /// Where a parameter stands in the standard vector; none of a parameter that this model does not have.
    pub fn place(&self, parameter: Parameter) -> Option<usize> {
        self.parameters.iter().position(|other| *other == parameter)
    }

    /// The same model with other bodies for the torque that the gears carry (one a joint, in its frame).
    ///
    /// # Panics
    /// If there is not one body a joint.
    #[must_use]
    pub fn with_load(mut self, bodies: Vec<LinkParameters>) -> Model {
        assert_eq!(bodies.len(), self.arm.dof(), "one body a joint");
        self.load = bodies;
        self
    }

    /// The same model where bodies of links are a guess: standard deviations of their entries, 0 of what is known (as
    /// [`guess_bodies`](crate::guess_bodies) gives them).
    #[must_use]
    pub fn with_unknown_bodies(mut self, std: Vec<f64>) -> Model {
        self.unknown = if std.iter().any(|std| *std > 0.0) { std } else { Vec::new() };
        self
    }

    /// Standard deviations of the entries of the standard vector that are a guess, 0 of what is known; empty where all bodies are known.
    pub fn unknown_bodies(&self) -> &[f64] {
        &self.unknown
    }

    /// The same model with effects of known size.
    #[must_use]
    pub fn with_effects(mut self, effects: KnownEffects) -> Model {
        self.effects = effects;
        self
    }

    /// Effects of known size beside the regressor.
    pub fn effects(&self) -> &KnownEffects {
        &self.effects
    }

    /// Bodies whose torque is what the gears carry.
    pub fn load(&self) -> &[LinkParameters] {
        &self.load
    }

    /// Number of standard parameters.
    #[expect(clippy::len_without_is_empty, reason = "a model always has parameters")]
    pub fn len(&self) -> usize {
        self.parameters.len()
    }

    /// Standard vector of the URDF's bodies and the given drives.
    ///
    /// # Panics
    /// If a list of `joints` that the structure reads is not one entry a joint.
    #[must_use]
    pub fn nominal(&self, joints: &Joints) -> Vec<f64> {
        let drives = |values: &[f64], what: &str| {
            assert_eq!(values.len(), self.arm.dof(), "one {what} value a joint");
            values.to_vec()
        };
        let mut x = self.arm.links.concat();
        x.extend(drives(&joints.rotor_inertia, "rotor inertia"));
        x.extend(drives(&joints.viscous, "viscous friction"));
        x.extend(drives(&joints.coulomb, "Coulomb friction"));
        if self.structure.offset {
            x.extend(drives(&joints.offset, "offset"));
        }
        if self.structure.load_friction {
            x.extend(drives(&joints.load_friction, "load friction"));
        }
        if self.structure.viscous_quadratic {
            x.extend(drives(&joints.viscous_quadratic, "quadratic friction"));
        }
        if self.structure.coupling.is_some() {
            x.extend(joints.coupling);
        }
        x
    }

    /// The drives of a standard vector: what [`nominal`](Model::nominal) took of them. What the model does not have is as in `others`.
    #[must_use]
    pub fn drives(&self, x: &[f64], others: Joints) -> Joints {
        let mut joints = others;
        for (parameter, &value) in self.parameters.iter().zip(x) {
            match *parameter {
                Parameter::Link { .. } => {}
                Parameter::RotorInertia(j) => joints.rotor_inertia[j] = value,
                Parameter::Viscous(j) => joints.viscous[j] = value,
                Parameter::Coulomb(j) => joints.coulomb[j] = value,
                Parameter::Offset(j) => joints.offset[j] = value,
                Parameter::LoadFriction(j) => joints.load_friction[j] = value,
                Parameter::ViscousQuadratic(j) => joints.viscous_quadratic[j] = value,
                Parameter::CouplingInertia => joints.coupling[0] = value,
                Parameter::CouplingViscous => joints.coupling[1] = value,
                Parameter::CouplingCoulomb => joints.coupling[2] = value,
            }
        }
        joints
    }

    /// Regressor of the whole model, N x [`len`](Model::len) row-major, written to `y`. Real-time safe.
    ///
    /// Drive of joint j: `τⱼ = Iaⱼ·q̈ⱼ + Fvⱼ·q̇ⱼ + Fcⱼ·s(q̇ⱼ) + offsetⱼ + klⱼ·|τ_loadⱼ|·s(q̇ⱼ) + Fqⱼ·q̇ⱼ·|q̇ⱼ|`, where τ_load is
    /// the torque of the links alone. Coupled motor, with a the driving and b the driven joint:
    /// `τa += Iam·q̈b + Fvm·q̇b + Fcm·s(q̇a + q̇b)`, `τb += Iam·q̈a + Fvm·q̇a + Fcm·s(q̇a + q̇b)`.
    ///
    /// Friction without memory, whatever [`Structure::presliding_travel`] says: for single states.
    pub fn regressor(&self, ws: &mut Workspace, q: &[f64], qd: &[f64], qdd: &[f64], y: &mut [f64]) {
        let states = [State { q, qd, qdd }];
        self.single(ws, states, &self.directions(states), y);
    }

    /// As [`regressor`](Model::regressor), for the states of one motion in their order: with
    /// [`Structure::presliding_travel`], friction has the direction that `slip` remembers. Real-time safe.
    pub fn regressor_sliding(
        &self,
        ws: &mut Workspace,
        slip: &mut Slip,
        q: &[f64],
        qd: &[f64],
        qdd: &[f64],
        y: &mut [f64],
    ) {
        let states = [State { q, qd, qdd }];
        let directions = if self.structure.presliding_travel > 0.0 {
            slip.advance(q);
            slip.directions().map(|z| [z])
        } else {
            self.directions(states)
        };
        self.single(ws, states, &directions, y);
    }

    fn single(
        &self,
        ws: &mut Workspace,
        states: [State<'_>; 1],
        directions: &[[f64; 1]; MAX_JOINTS + 1],
        y: &mut [f64],
    ) {
        let ([State { q, qd, qdd }], width) = (states, self.len());
        regressor_rows(&self.arm, ws, q, qd, qdd, y, width);
        for row in y.chunks_exact_mut(width) {
            row[LINK_PARAMETERS * self.arm.dof()..].fill(0.0);
        }
        self.drive_columns(states, directions, y.as_chunks_mut::<1>().0);
    }

    /// [`regressor`](Model::regressor) of two states at once, `[first, second]` in each entry, for about the cost of one.
    ///
    /// Entries that are zero by structure are not written: hand in zeros the first time. Real-time safe.
    pub fn regressor_pair(&self, ws: &mut Workspace, states: [State<'_>; 2], y: &mut [[f64; 2]]) {
        regressor_pair_rows(&self.arm, ws, states, y, self.len());
        self.drive_columns(states, &self.directions(states), y);
    }

    /// As [`regressor_pair`](Model::regressor_pair), for the states of two motions in their order: with
    /// [`Structure::presliding_travel`], friction has the directions that `slips` remember. Real-time safe.
    pub fn regressor_pair_sliding(
        &self,
        ws: &mut Workspace,
        slips: &mut [Slip; 2],
        states: [State<'_>; 2],
        y: &mut [[f64; 2]],
    ) {
        if self.structure.presliding_travel <= 0.0 {
            return self.regressor_pair(ws, states, y);
        }
        for (slip, state) in slips.iter_mut().zip(&states) {
            slip.advance(state.q);
        }
        let [a, b] = [slips[0].directions(), slips[1].directions()];
        regressor_pair_rows(&self.arm, ws, states, y, self.len());
        self.drive_columns(states, &std::array::from_fn(|j| [a[j], b[j]]), y);
    }

    /// Directions of friction, joint by joint and then of the coupled motor, of each state.
    fn directions<const STATES: usize>(&self, states: [State<'_>; STATES]) -> [[f64; STATES]; MAX_JOINTS + 1] {
        let v0 = self.structure.sign_velocity;
        let sign = |v: [f64; STATES]| -> [f64; STATES] {
            if v0 > 0.0 {
                let pair = Lanes::tanh(Pair::new([v[0] / v0, v[STATES - 1] / v0])).to_array();
                std::array::from_fn(|lane| pair[lane])
            } else {
                v.map(|v| friction_sign(v, v0))
            }
        };
        let mut directions = [[0.0; STATES]; MAX_JOINTS + 1];
        for (j, direction) in directions[..self.arm.dof()].iter_mut().enumerate() {
            *direction = sign(std::array::from_fn(|lane| states[lane].qd[j]));
        }
        if let Some(WristCoupling { driving, driven }) = self.structure.coupling {
            directions[MAX_JOINTS] =
                sign(std::array::from_fn(|lane| states[lane].qd[driving] + states[lane].qd[driven]));
        }
        directions
    }

    /// The drives' columns of one or two states, where they are not zero by structure.
    fn drive_columns<const STATES: usize>(
        &self,
        states: [State<'_>; STATES],
        directions: &[[f64; STATES]; MAX_JOINTS + 1],
        y: &mut [[f64; STATES]],
    ) {
        let (dof, width) = (self.arm.dof(), self.len());
        let qd = |j: usize| -> [f64; STATES] { std::array::from_fn(|lane| states[lane].qd[j]) };
        let qdd = |j: usize| -> [f64; STATES] { std::array::from_fn(|lane| states[lane].qdd[j]) };
        let drives = LINK_PARAMETERS * dof;
        for j in 0..dof {
            let (links, row) = y[j * width..(j + 1) * width].split_at_mut(drives);
            row[j] = qdd(j);
            row[dof + j] = qd(j);
            row[2 * dof + j] = directions[j];
            let mut at = 3 * dof + j;
            if self.structure.offset {
                row[at] = [1.0; STATES];
                at += dof;
            }
            if self.structure.load_friction {
                row[at] = std::array::from_fn(|lane| {
                    let carried: f64 = links.iter().zip(self.load.as_flattened()).map(|(y, x)| y[lane] * x).sum();
                    carried.abs() * directions[j][lane]
                });
                at += dof;
            }
            if self.structure.viscous_quadratic {
                row[at] = qd(j).map(|v| v * v.abs());
            }
        }
        if let Some(WristCoupling { driving, driven }) = self.structure.coupling {
            for (joint, other) in [(driving, driven), (driven, driving)] {
                let end = (joint + 1) * width;
                y[end - 3..end].copy_from_slice(&[qdd(other), qd(other), directions[MAX_JOINTS]]);
            }
        }
    }
}
