//! Which parameters may act: every published set has to earn it.

use crate::inertia::StoredPoses;
use crate::law::{ControlLaw, Desired};
use crate::limits::middle;
use crate::matrix::cholesky_succeeds;
use rivet_config::Robot;
use rivet_dynamics::{MAX_JOINTS, Parameter};
pub use rivet_ipc_schema::ParameterRefusal as Refusal;
use rivet_ipc_schema::{MAX_PARAMETERS, Parameters, parameter_flags};

/// What the user reads about a refusal.
pub fn refusal_text(refusal: Refusal) -> &'static str {
    match refusal {
        Refusal::None => "adopted",
        Refusal::OtherModel => "made for another model (hash differs): start both from the same robot.toml",
        Refusal::WrongCount => "number of parameters differs from the model's",
        Refusal::Old => "not newer than the set before",
        Refusal::Future => "made from samples that have not come yet",
        Refusal::Stale => "made from samples too long ago",
        Refusal::EpochBack => {
            "its epoch goes back while the daemon is alive: a second publisher, or a replayed message"
        }
        Refusal::Provisional => "the daemon marks it provisional: too little data so far",
        Refusal::NotFinite => "a value is not finite",
        Refusal::DrivingFriction => "its friction would drive a joint",
        Refusal::InertiaNotPositive => {
            "inertia below a tenth of the robot file's: is that too large (rotor_inertia, tool)?"
        }
        Refusal::TorqueChange => "it would change the present torque by more than [controller] torque_change",
        Refusal::PredictsWorse => "it predicts recent torques worse than what is in use",
        Refusal::OtherPeriod => {
            "the sample period is another one: that of the daemon, or the rate at which samples come, is not the robot file's"
        }
        Refusal::Implausible => {
            "the arm would need several times its drives' torque to carry itself, or against friction"
        }
        Refusal::NotJudged => "the arm has not moved enough to tell whether it is better than what is in use",
    }
}

/// Poses, beside the present one, at which the inertia matrix has to be positive definite.
pub const STORED_POSES: usize = 20;

/// Inertia that a set must leave in every direction, in parts of the robot file's. An inertia matrix that is just positive
/// at one pose is not at the next, and feedback through it leaves the arm to itself on the way there; what users get wrong
/// about bodies and rotors is less.
const LEAST_INERTIA: f64 = 0.1;

/// Speed at which friction is looked at for a joint that states no limit \[rad/s\].
const DEFAULT_SPEED: f64 = 5.0;

/// Torque for rest, for 1 rad/s² and for friction at the speed limit that a set may need, in parts of the drives' limit or of what the
/// robot file's own values need: an arm that is further off could not have been measured in motion.
const MOST_TORQUE: f64 = 4.0;

/// What the gate knows about the last sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Newest {
    /// Epoch of the newest set that passed; 0 before the first.
    pub epoch: u64,
    /// Sample number of the newest set that passed.
    pub seq: u64,
    /// Whether sets have been passing until now: only then is an epoch that goes back no restart of the daemon.
    pub alive: bool,
}

/// Holds what the checks need, prepared.
pub struct Gate {
    hash: u64,
    period_s: f64,
    count: usize,
    dof: usize,
    oldest: u64,
    friction: Friction,
    poses: StoredPoses,
    change: [f64; MAX_JOINTS],
    mass: Vec<f64>,
    /// The parameters of the least inertia matrix; zeros where the robot file's own is not positive definite.
    least: Vec<f64>,
    /// What a set has beyond it.
    beyond: Vec<f64>,
    /// Most torque that a set may need for rest and 1 rad/s², and for friction \[N·m\].
    carried: [f64; MAX_JOINTS],
    rubbed: [f64; MAX_JOINTS],
}

impl Gate {
    /// Prepares the checks for one robot.
    pub fn new(robot: &Robot, law: &mut ControlLaw) -> Gate {
        let settings = &robot.config.controller;
        let dof = robot.dof();
        let count = robot.base.len().min(MAX_PARAMETERS);
        let mut change = [0.0; MAX_JOINTS];
        for (change, limit) in change.iter_mut().zip(&robot.config.drive.torque_limit) {
            *change = settings.torque_change * limit;
        }
        let mut poses = StoredPoses::new(law, robot.base.len(), &stored_poses(robot));
        let nominal = robot.base_parameters();
        let sound = poses.all_positive(nominal);
        let (friction, torque) = (Friction::of(robot), poses.largest_torque(nominal));
        let limits = &robot.config.drive.torque_limit;
        let most = |needed: [f64; MAX_JOINTS]| {
            let mut most = [f64::INFINITY; MAX_JOINTS];
            for (j, most) in most.iter_mut().enumerate().take(dof) {
                *most = MOST_TORQUE * limits[j].max(needed[j]);
            }
            most
        };
        let (carried, rubbed) = (most(torque), most(friction.largest_torque(nominal)));
        let least = nominal.iter().map(|x| if sound { LEAST_INERTIA * x } else { 0.0 }).collect();
        Gate {
            hash: robot.hash,
            period_s: robot.config.sample_period_s,
            count,
            dof,
            oldest: (settings.parameter_timeout_s / robot.config.sample_period_s).ceil() as u64,
            friction,
            poses,
            change,
            mass: vec![0.0; dof * dof],
            least,
            beyond: vec![0.0; robot.base.len()],
            carried,
            rubbed,
        }
    }

    /// Whether the message is what it should be: made for this model, finite, and newer than the ones before. `now` is the
    /// number of the sample at hand. Real-time safe.
    ///
    /// # Errors
    /// The first rule it breaks.
    pub fn check_message(&self, set: &Parameters, newest: Newest, now: u64) -> Result<(), Refusal> {
        let rules = [
            (set.model_hash == self.hash, Refusal::OtherModel),
            ((set.sample_period_s / self.period_s - 1.0).abs() < 1e-6, Refusal::OtherPeriod),
            (set.len() == self.count && set.count as usize == self.count, Refusal::WrongCount),
            (set.seq <= now, Refusal::Future),
            (newest.epoch == 0 || set.seq > newest.seq, Refusal::Old),
            (now.saturating_sub(set.seq) <= self.oldest, Refusal::Stale),
            (set.epoch > 0 && (set.epoch > newest.epoch || !newest.alive), Refusal::EpochBack),
            (set.flags & parameter_flags::PROVISIONAL == 0, Refusal::Provisional),
            (set.values[..self.count].iter().all(|x| x.is_finite()), Refusal::NotFinite),
        ];
        rules.iter().find(|(holds, _)| !holds).map_or(Ok(()), |(_, why)| Err(*why))
    }

    /// Whether `values` describe an arm: friction takes energy out of every motion, the drives can carry it, and the inertia matrix leaves a
    /// part of the robot file's in every direction at the stored poses and, where the arm is known to be, at `q`. Real-time safe.
    ///
    /// # Errors
    /// Which of these is not so.
    pub fn check_physics(&mut self, values: &[f64], q: Option<&[f64]>, law: &mut ControlLaw) -> Result<(), Refusal> {
        if !values.iter().all(|x| x.is_finite()) {
            return Err(Refusal::NotFinite);
        }
        if !self.friction.dissipates(values) {
            return Err(Refusal::DrivingFriction);
        }
        if q.is_some_and(|q| !self.has_inertia(values, q, law)) {
            return Err(Refusal::InertiaNotPositive);
        }
        let needs =
            [(self.poses.largest_torque(values), &self.carried), (self.friction.largest_torque(values), &self.rubbed)];
        // What is not a number is too much.
        if !needs.iter().all(|(needed, most)| (0..self.dof).all(|j| needed[j] <= most[j])) {
            return Err(Refusal::Implausible);
        }
        self.exceed(values);
        if self.poses.all_positive(&self.beyond) { Ok(()) } else { Err(Refusal::InertiaNotPositive) }
    }

    /// Whether the inertia matrix of `values` leaves a part of the robot file's in every direction at `q`. Real-time safe.
    pub fn has_inertia(&mut self, values: &[f64], q: &[f64], law: &mut ControlLaw) -> bool {
        self.exceed(values);
        // It is linear in the parameters.
        law.inertia(q, &self.beyond, &mut self.mass);
        cholesky_succeeds(&mut self.mass, self.dof)
    }

    fn exceed(&mut self, values: &[f64]) {
        for ((beyond, x), least) in self.beyond.iter_mut().zip(values).zip(&self.least) {
            *beyond = x - least;
        }
    }

    /// Whether the torque of the present setpoint stays within the permitted change from `used` to `values`. Real-time safe.
    ///
    /// # Errors
    /// [`Refusal::TorqueChange`].
    pub fn check_change(
        &self,
        values: &[f64],
        used: &[f64],
        desired: &Desired,
        law: &mut ControlLaw,
    ) -> Result<(), Refusal> {
        let n = self.dof;
        let (mut new, mut old) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        law.model_torque(&desired.q[..n], &desired.qd[..n], &desired.qdd[..n], values, &mut new[..n]);
        law.model_torque(&desired.q[..n], &desired.qd[..n], &desired.qdd[..n], used, &mut old[..n]);
        let fits = (0..n).all(|j| (new[j] - old[j]).abs() <= self.change[j]);
        if fits { Ok(()) } else { Err(Refusal::TorqueChange) }
    }
}

/// Poses spread over the joint ranges: a Kronecker lattice of the generalised golden ratio (Roberts 2018), the same every
/// time.
fn stored_poses(robot: &Robot) -> Vec<Vec<f64>> {
    let joints = &robot.model.arm.joints;
    let mut ratio = 1.5_f64;
    for _ in 0..40 {
        ratio = (1.0 + ratio).powf(1.0 / (joints.len() + 1) as f64);
    }
    let pose = |k: usize| {
        let at = |(j, joint): (usize, &rivet_dynamics::Joint)| {
            let share = (0.5 + (k + 1) as f64 * ratio.powf(-((j + 1) as f64))).fract();
            let range = joint.upper - joint.lower;
            let half = if range.is_finite() && range > 0.0 { 0.5 * range } else { std::f64::consts::PI };
            middle(joint.lower, joint.upper) + (2.0 * share - 1.0) * half
        };
        joints.iter().enumerate().map(at).collect()
    };
    (0..STORED_POSES).map(pose).collect()
}

/// Where friction stands among the base parameters, and the speeds that joints reach.
pub(crate) struct Friction {
    viscous: [Option<usize>; MAX_JOINTS],
    coulomb: [Option<usize>; MAX_JOINTS],
    speed: [f64; MAX_JOINTS],
    /// Driving and driven joint, viscous and Coulomb coefficient of a coupled motor.
    coupled: Option<(usize, usize, Option<usize>, Option<usize>)>,
    dof: usize,
}

/// Ratios of the speeds of two coupled joints at which their dissipation is looked at.
const RATIOS: [(f64, f64); 8] =
    [(1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, -1.0), (1.0, 0.5), (1.0, -0.5), (0.5, 1.0), (-0.5, 1.0)];

impl Friction {
    pub(crate) fn of(robot: &Robot) -> Friction {
        let place = |wanted: Parameter| {
            let standard = robot.model.parameters.iter().position(|p| *p == wanted)?;
            robot.base.independent.iter().position(|column| *column == standard)
        };
        let mut friction =
            Friction {
                viscous: [None; MAX_JOINTS],
                coulomb: [None; MAX_JOINTS],
                speed: [DEFAULT_SPEED; MAX_JOINTS],
                coupled: robot.model.structure.coupling.map(|c| {
                    (c.driving, c.driven, place(Parameter::CouplingViscous), place(Parameter::CouplingCoulomb))
                }),
                dof: robot.dof(),
            };
        for (j, joint) in robot.model.arm.joints.iter().enumerate() {
            friction.viscous[j] = place(Parameter::Viscous(j));
            friction.coulomb[j] = place(Parameter::Coulomb(j));
            if joint.velocity.is_finite() && joint.velocity > 0.0 {
                friction.speed[j] = joint.velocity;
            }
        }
        friction
    }

    /// Friction of each joint at its speed limit \[N·m\]; coupled joints, which share theirs, with the whole of it. NaN where `x` is
    /// not finite.
    fn largest_torque(&self, x: &[f64]) -> [f64; MAX_JOINTS] {
        let value = |place: Option<usize>| place.map_or(0.0, |i| x[i].abs());
        let mut most = [0.0; MAX_JOINTS];
        for (j, most) in most.iter_mut().enumerate().take(self.dof) {
            *most = value(self.coulomb[j]) + value(self.viscous[j]) * self.speed[j];
            if let Some((a, b, viscous, coulomb)) = self.coupled
                && (j == a || j == b)
            {
                *most += value(coulomb) + value(viscous) * self.speed[a].max(self.speed[b]);
            }
        }
        most
    }

    /// Coulomb friction of each joint \[N·m\]; coupled joints, which share theirs, with the whole of it. Real-time safe.
    pub(crate) fn coulomb(&self, x: &[f64]) -> [f64; MAX_JOINTS] {
        let value = |place: Option<usize>| place.map_or(0.0, |i| x[i].abs());
        let shared = |j: usize| {
            let (.., coulomb) = self.coupled.filter(|(a, b, ..)| j == *a || j == *b)?;
            coulomb
        };
        std::array::from_fn(|j| value(self.coulomb[j]) + value(shared(j)))
    }

    /// Whether friction takes power out of every motion up to the joints' speeds.
    ///
    /// Along a ray `q̇ = s·v`, s in 0..1, the power is `s·c(v) + s²·d(v)`, c from Coulomb and d from viscous friction: it is
    /// nowhere negative if `c ≥ 0` and `c + d ≥ 0`. A slightly negative viscous coefficient beside a large Coulomb one, as
    /// noise makes it where the true one is about zero, drives nothing.
    fn dissipates(&self, x: &[f64]) -> bool {
        let value = |place: Option<usize>| place.map_or(0.0, |i| x[i]);
        let own = |j: usize, v: f64| (value(self.coulomb[j]) * v.abs(), value(self.viscous[j]) * v * v);
        let sound = |(c, d): (f64, f64)| c >= 0.0 && c + d >= 0.0;
        let coupled = |j| self.coupled.is_some_and(|(a, b, ..)| j == a || j == b);
        if !(0..self.dof).filter(|j| !coupled(*j)).all(|j| sound(own(j, self.speed[j]))) {
            return false;
        }
        let Some((a, b, viscous, coulomb)) = self.coupled else { return true };
        RATIOS.iter().all(|(ra, rb)| {
            let (va, vb) = (ra * self.speed[a], rb * self.speed[b]);
            let ((ca, da), (cb, db)) = (own(a, va), own(b, vb));
            // The model's coupled terms: Fvm·(va·q̇b + vb·q̇a) and Fcm·s(va + vb)·(va + vb).
            sound((ca + cb + value(coulomb) * (va + vb).abs(), da + db + 2.0 * value(viscous) * va * vb))
        })
    }
}
