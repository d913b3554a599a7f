//! Forward selection of effects on the training runs.

use crate::effects::Form;
use crate::effects::base_flexibility::Base;
use crate::effects::encoder_eccentricity::{Eccentricity, PositionScale};
use crate::effects::physics::Physics;
use crate::effects::{Effect, Kind};
use crate::fit::evidence::{FOLDS, PRIOR_SCALES};
use crate::fit::search::{Candidate, Search, Standing};
use crate::model::listener::Listener;
use crate::policy::POLICY;
use crate::select::adopted::{Adopted, Rival, is_full, is_part};
use crate::select::angle_law;
use crate::select::angle_orders;
use crate::select::base_support;
use crate::select::contact_bursts;
use crate::select::delay_or_lag::Clock;
use crate::select::hysteresis;
use crate::select::residual::Residue;
use crate::select::sign_flips::Flips;

use material::{held_out_shares, is_material};

mod material;

/// Times that forms are held against each other, each time at the noise that the best has left.
const CONTEST_ROUNDS: usize = 4;

/// What was adopted, and what was not.
pub(crate) struct Selected<'a> {
    pub(crate) adopted: Vec<Adopted>,
    /// Signals of the runs with the values that are known now: rigid torque, gain and friction columns follow them.
    pub(crate) physics: Vec<Physics<'a>>,
    /// Candidates of the last round, none of them worth it; empty where as many as may be were adopted.
    pub(crate) candidates: Vec<Candidate>,
}

impl<'a> Selected<'a> {
    /// Nothing so far.
    pub(crate) fn new(search: &Search<'a>) -> Option<Selected<'a>> {
        Some(Selected { adopted: Vec::new(), physics: search.physics()?, candidates: Vec::new() })
    }

    /// Adopts effects one after another until none is worth it; none where equations have no solution: then it ends with those
    /// before. The listener gets every decision.
    pub(crate) fn select(&mut self, search: &mut Search<'a>, listener: &mut dyn Listener) -> Option<()> {
        while !is_full(&self.adopted) {
            listener.line(&format!("round {}", self.adopted.len() + 1));
            let orders = angle_orders::find(&self.physics);
            self.candidates.clear();
            let flips = Flips::new(search)?;
            self.candidates = {
                let scoring = |candidate: &Candidate| flips.scores(search, candidate, &candidate.columns);
                let bursts = contact_bursts::find(search)?;
                search.candidates(&self.physics, &orders, &bursts, Some(&scoring), listener)
            };
            listener.line(&format!("{} candidates", self.candidates.len()));
            let round = Round {
                search,
                candidates: &self.candidates,
                physics: &self.physics,
                adopted: &self.adopted,
                flips: Some(&flips),
                refined: true,
            };
            let found = round.best(listener)?;
            let Some((candidate, adoption)) = found else {
                return angle_law::mark(search, &self.candidates, &mut self.adopted);
            };
            self.adopt(search, &candidate, adoption, listener)?;
            self.settle(search, &candidate, listener)?;
        }
        self.candidates.clear();
        Some(())
    }

    /// Adds an effect to the model; none where the equations have no solution with it: then all is as before.
    pub(crate) fn adopt(
        &mut self,
        search: &mut Search<'a>,
        candidate: &Candidate,
        mut adoption: Adopted,
        listener: &mut dyn Listener,
    ) -> Option<()> {
        let Some(mut physics) = search.extend(candidate, &adoption.mean) else {
            listener.line(&format!("no solution with {:?}", adoption.form));
            return None;
        };
        if adoption.form.shifts_time() {
            physics = search.made_again(candidate, &mut adoption, physics)?;
        }
        listener.line(&format!(
            "adopted {:?} (log evidence +{:.0}, held-out share {:.2})",
            adoption.form, adoption.gain, adoption.share
        ));
        self.adopted.push(adoption);
        self.physics = physics;
        Some(())
    }
}

/// A candidate that is worth a name.
struct Accepted {
    candidate: Candidate,
    standing: Standing,
    /// Of each joint's residual variance that it removes, held out, and the largest of them.
    shares: Vec<f64>,
    share: f64,
    p_value: Option<f64>,
}

impl Accepted {
    /// The joint of a constant torque; none for another form.
    fn constant_on(&self) -> Option<Vec<usize>> {
        self.candidate.form.is_torque_zero().then(|| self.candidate.form.joints())
    }
}

/// A candidate to adopt, if any.
pub(crate) type Found = Option<(Candidate, Adopted)>;

/// A round of the selection: candidates against the model as it stands.
pub(crate) struct Round<'a> {
    pub(crate) search: &'a Search<'a>,
    pub(crate) candidates: &'a [Candidate],
    pub(crate) physics: &'a [Physics<'a>],
    pub(crate) adopted: &'a [Adopted],
    /// Sign flips of the residual, for the chance of each candidate; none where that is not asked.
    pub(crate) flips: Option<&'a Flips>,
    /// Whether inner values are refined; else they stay as on the grid.
    pub(crate) refined: bool,
}

/// The best candidates of a round by evidence.
struct Listed {
    candidates: Vec<(Candidate, Standing)>,
    /// Forms of bristles that may be all of the friction beside what else is missing, or not.
    doubtful: Vec<Form>,
}

impl Round<'_> {
    /// The candidate to adopt next, if any is worth it. None where equations have no solution.
    pub(crate) fn best(&self, listener: &mut dyn Listener) -> Option<Found> {
        let clock = Clock::default();
        let Listed { candidates: listed, doubtful } = self.listed(&clock, listener)?;
        let accepted = self.accepted(listed, listener)?;
        if accepted.is_empty() {
            return Some(None);
        }
        let (near, simplest) = self.simplest(&accepted, listener)?;
        self.adoption(accepted, &near, simplest, &doubtful, &clock).map(Some)
    }

    /// The best of each effect on each joint, refined, in the order of their evidence.
    fn listed(&self, clock: &Clock, listener: &mut dyn Listener) -> Option<Listed> {
        let Round { search, candidates, physics, adopted, refined, .. } = *self;
        let standings = search.rank(candidates)?;
        let residue = Residue::from_search(search);
        let least = POLICY.adoption.min_gain[adopted.len().min(1)];
        // The best of each effect on each joint, refined.
        let taken: Vec<(Effect, Vec<usize>)> = adopted.iter().map(|a| (a.form.effect(), a.form.joints())).collect();
        let mut seen: Vec<(Effect, Vec<usize>, usize)> = Vec::new();
        let mut listed: Vec<(Candidate, Standing)> = Vec::new();
        let mut doubtful: Vec<Form> = Vec::new();
        let noisy_beside =
            |form: &Form| (0..search.noise.len()).any(|j| !form.joints().contains(&j) && residue.is_noisy(j));
        for standing in &standings {
            if standing.gain < 0.3 * least || listed.len() == POLICY.adoption.max_refined_candidates {
                break;
            }
            let form = &candidates[standing.at].form;
            // Half of it is a constant, or it bends as it likes: where other joints keep more than noise, as on measured arms,
            // this one does too, and that may look so.
            let bends = form.is_nameless() || form.is_half_constant();
            if bends && noisy_beside(form) {
                continue;
            }
            if self.is_repeated(form) {
                continue;
            }
            let (effect, joints) = (form.effect(), form.joints());
            let another = self.is_another_mode(form);
            let key = (effect, joints.clone(), form.kind());
            if taken.contains(&(effect, joints)) && !another || seen.contains(&key) {
                continue;
            }
            seen.push(key);
            // On the grid a simulated form may be off by a step; one that is wanted at quite another size is not it.
            if !refined && form.has_fixed_gain() && (standing.added.c[0] - 1.0).abs() > POLICY.adoption.max_gain_error {
                continue;
            }
            let (candidate, standing) = if !refined {
                (candidates[standing.at].clone(), standing.clone())
            } else if form.shifts_time() {
                let Some(sized) = search.late(form, clock, physics)? else { continue };
                if listed.iter().any(|(other, _)| other.form == sized.0.form) {
                    continue;
                }
                sized
            } else {
                search.refine(form, physics)?
            };
            let kind = if refined {
                hysteresis::kind(search, physics, (&candidate, &standing), listener)?
            } else {
                hysteresis::Kind::AsNamed
            };
            match kind {
                hysteresis::Kind::Beside(beside) if !noisy_beside(&beside.0.form) => listed.push(*beside),
                hysteresis::Kind::Of(bristles) => listed.push(*bristles),
                // As on measured arms: it may be all of the friction beside what else is missing there, or not.
                hysteresis::Kind::Beside(_) => {
                    doubtful.push(candidate.form.clone());
                    listed.push((candidate, standing));
                }
                hysteresis::Kind::Own => {}
                hysteresis::Kind::AsNamed => listed.push((candidate, standing)),
            }
        }
        listed.sort_by(|a, b| b.1.gain.total_cmp(&a.1.gain));
        Some(Listed { candidates: listed, doubtful })
    }

    /// Whether a form repeats with the order of an effect that is there already, or shifts torque in time beside one that does: that is
    /// what that one's form misses.
    fn is_repeated(&self, form: &Form) -> bool {
        let again = |a: &Adopted| {
            a.form.shifts_time() && form.shifts_time() || a.form.joints() == form.joints() && same_order(&a.form, form)
        };
        self.adopted.iter().any(again)
    }

    /// Whether a form is a base that gives way about another axis than those adopted: it may about two.
    fn is_another_mode(&self, form: &Form) -> bool {
        form.get::<Base>().is_some_and(|base| {
            let others = self.adopted.iter().filter_map(|a| a.form.get::<Base>());
            others.into_iter().all(|before| base.mode.is_other(&before.mode))
        })
    }

    /// Those of the listed that are worth a name.
    fn accepted(&self, listed: Vec<(Candidate, Standing)>, listener: &mut dyn Listener) -> Option<Vec<Accepted>> {
        let Round { search, candidates, physics, adopted, flips, .. } = *self;
        let p_values =
            flips.map_or_else(|| vec![None; listed.len()], |flips| flips.p_values(search, &listed, candidates));
        let residue = Residue::from_search(search);
        let least = POLICY.adoption.min_gain[adopted.len().min(1)];
        let mut accepted: Vec<Accepted> = Vec::new();
        // Values that are no effect beside what was adopted: a form that is let in because it hides does not stand in for one of these.
        let mut values: Vec<(Vec<usize>, f64)> = Vec::new();
        for ((candidate, standing), p_value) in listed.into_iter().zip(p_values) {
            let shares = held_out_shares(search, &candidate)?;
            let share = shares.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            listener.line(&format!(
                "  {:7.1} {:?} c {:.4?} held-out {shares:.2?} p {}",
                standing.gain,
                candidate.form,
                standing.added.c.as_slice(),
                p_value.map_or_else(|| "-".to_owned(), |p| format!("{p:.3}"))
            ));
            let hides = candidate.form.hides() && (adopted.is_empty() || hides_beside(&candidate.form, &residue));
            let joints = candidate.form.joints();
            let outdone =
                values.iter().any(|(on, gain)| *on == joints && *gain > standing.gain + POLICY.adoption.rival_gap);
            // Every fold would have to know a force that only its own blocks felt.
            let material = candidate.form.has_stretches()
                || hides && !outdone
                || is_material(search, (&candidate.form, standing.gain), &shares, adopted);
            let cuts_command = candidate.form.effect().about().cuts_command;
            let cut = !cuts_command || shares.iter().any(|share| *share >= POLICY.adoption.min_saturation_share);
            let shown = candidate.form.get::<Base>().is_none_or(|base| {
                base_support::is_felt(&shares)
                    && base_support::is_frequency_identified(search, &base.mode, standing.gain, physics)
            });
            let plausible = self.is_plausible(&candidate, &standing) && cut && shown;
            // What the values imitate is told by what is believed of them, a torque that is cut by its command.
            let by_residual = !candidate.form.hides() && !cuts_command;
            let by_chance = by_residual && p_value.is_some_and(|p| p > POLICY.adoption.max_false_alarm_rate);
            if !material && plausible && !by_chance && candidate.form.effect().kind() == Kind::Value {
                values.push((joints, standing.gain));
            }
            if standing.gain >= least && material && plausible && !by_chance {
                // Where values have taken it up the residual shows nothing, and its figure says nothing.
                let p_value = p_value.filter(|p| by_residual || *p <= POLICY.adoption.max_false_alarm_rate);
                accepted.push(Accepted { candidate, standing, shares, share, p_value });
            }
        }
        Some(accepted)
    }

    /// Whether an effect can be so.
    fn is_plausible(&self, candidate: &Candidate, standing: &Standing) -> bool {
        let (form, c) = (&candidate.form, standing.added.c.as_slice());
        form.plausible(c)
            && !is_mounted_too_badly(self.search, form, c)
            && !is_part(form, standing)
            && !is_level(form, c)
    }

    /// Places of those that explain about as much as the best, and of the simplest of them.
    fn simplest(&self, accepted: &[Accepted], listener: &mut dyn Listener) -> Option<(Vec<usize>, usize)> {
        // Of those that explain it about as well, the simplest.
        let top = accepted[0].standing.gain;
        let near: Vec<usize> = (0..accepted.len())
            .filter(|i| {
                accepted[*i].standing.gain >= POLICY.adoption.min_rival_gain_share * top
                    && accepted[*i].standing.gain >= top - POLICY.adoption.rival_gap
            })
            .collect();
        let contestants: Vec<&Candidate> = near.iter().map(|i| &accepted[*i].candidate).collect();
        let holds = contest(self.search, &contestants, listener)?;
        let (near, gains): (Vec<usize>, Vec<f64>) =
            near.into_iter().zip(holds).filter_map(|(i, gain)| Some((i, gain?))).unzip();
        // A law of the angle that is no better than a constant is one.
        let constants: Vec<Vec<usize>> = near.iter().filter_map(|i| accepted[*i].constant_on()).collect();
        let law = |i: &usize| {
            let form = &accepted[*i].candidate.form;
            form.of_angle_alone() && constants.contains(&form.joints())
        };
        let (near, gains): (Vec<usize>, Vec<f64>) = near.into_iter().zip(gains).filter(|(i, _)| !law(i)).unzip();
        let most = near.iter().map(|i| accepted[*i].share).fold(f64::NEG_INFINITY, f64::max);
        let simplest = near
            .iter()
            .copied()
            .zip(gains)
            .filter(|(i, _)| {
                accepted[*i].share >= most - POLICY.adoption.min_share_over_simplicity * most.abs().max(1.0)
            })
            .min_by(|(a, its), (b, others)| {
                let size = |i: usize| {
                    let candidate = &accepted[i].candidate;
                    (candidate.form.is_nameless(), candidate.numbers())
                };
                size(*a).cmp(&size(*b)).then(others.total_cmp(its)).then(a.cmp(b))
            })
            .map_or(0, |(i, _)| i);
        Some((near, simplest))
    }

    /// The effect to adopt of the accepted at `near`, with what else explains the same.
    fn adoption(
        &self,
        mut accepted: Vec<Accepted>,
        near: &[usize],
        simplest: usize,
        doubtful: &[Form],
        clock: &Clock,
    ) -> Option<(Candidate, Adopted)> {
        let Round { search, physics, .. } = *self;
        let mut rivals = Vec::new();
        // Over a part of a turn a scale of the position looks like an encoder that is mounted badly, and neither is told then.
        let scale = |i: &usize| accepted[*i].candidate.form.get::<PositionScale>().is_some();
        let form = &accepted[simplest].candidate.form;
        let another_law = form.get::<Eccentricity>().is_some() && near.iter().any(scale)
            || doubtful.contains(form)
            || angle_law::cancels(&accepted[simplest].candidate, accepted[simplest].standing.added.c.as_slice());
        if near.len() > 1 {
            let solved = search.solved(search.scale)?;
            let (one, its) = (&accepted[simplest].candidate, &accepted[simplest].standing);
            for Accepted { candidate: other, standing, .. } in near.iter().map(|i| &accepted[*i]) {
                if other.form.effect() != one.form.effect() && !other.form.is_nameless() {
                    let cosine = search.cosine(&solved, (one, &its.added.c), (other, &standing.added.c))?;
                    // Of two laws of one joint's angle that explain as much one is true, however they bend.
                    let laws = one.form.of_angle_alone() && other.form.of_angle_alone();
                    let either = laws && one.form.joints() == other.form.joints();
                    rivals.extend(if either {
                        Some(Rival { form: other.form.clone(), cosine, is_kept: false })
                    } else {
                        Rival::if_confounded(&other.form, cosine)
                    });
                }
            }
        }
        rivals.extend(self.other_laws(&accepted, near, simplest)?);
        let Accepted { candidate, standing, share, shares, p_value } = accepted.swap_remove(simplest);
        if candidate.form.shifts_time() && rivals.iter().all(|rival: &Rival| !rival.form.shifts_time()) {
            rivals.extend(search.other_kind_of_late((&candidate, &standing), clock, physics));
        }
        let adoption = Adopted {
            shares,
            share,
            p_value,
            rivals,
            another_law,
            ..Adopted::new(search, &candidate, physics, standing.gain)?
        };
        Some((candidate, adoption))
    }
}

impl Round<'_> {
    /// The spring of the same joint that explains nearly as much as a counterbalance, where the joint turns less than half a turn: a spring
    /// beside bodies that a file gives wrongly looks so. The other way round it does not: wrong bodies are waves themselves.
    fn other_laws(&self, accepted: &[Accepted], near: &[usize], simplest: usize) -> Option<Vec<Rival>> {
        let Round { search, .. } = *self;
        let one = &accepted[simplest];
        let [joint] = one.candidate.form.joints()[..] else { return Some(Vec::new()) };
        if !one.candidate.form.effect().about().balances_gravity
            || angle_law::range(search, joint) >= std::f64::consts::PI
        {
            return Some(Vec::new());
        }
        let effect = one.candidate.form.effect();
        let is_law = |i: &usize| {
            let other = &accepted[*i];
            let form = &other.candidate.form;
            !near.contains(i)
                && form.of_angle_alone()
                && !form.is_nameless()
                && form.effect() != effect
                && form.joints() == [joint]
                && other.standing.gain >= POLICY.adoption.min_law_gain_share * one.standing.gain
        };
        let Some(other) = (0..accepted.len()).find(is_law).map(|i| &accepted[i]) else { return Some(Vec::new()) };
        let solved = search.solved(search.scale)?;
        let pair = [one, other].map(|a| (&a.candidate, &a.standing.added.c));
        let cosine = search.cosine(&solved, (pair[0].0, pair[0].1), (pair[1].0, pair[1].1))?;
        Some(vec![Rival { form: other.candidate.form.clone(), cosine, is_kept: true }])
    }
}

/// Whether an encoder is off as none is. Over a whole turn it may be all the same; over a part of one it is a scale of the position, or a zero.
fn is_mounted_too_badly(search: &Search<'_>, form: &Form, c: &[f64]) -> bool {
    matches!(form.get(), Some(&Eccentricity { joint })
        if c[0].hypot(c[1]) > POLICY.adoption.max_eccentricity_rad && angle_law::range(search, joint) < std::f64::consts::PI)
}

/// Whether friction over the angle is but its level: what slow motion says of a wrong Coulomb friction, with a wave of any order beside it.
fn is_level(form: &Form, c: &[f64]) -> bool {
    form.wave_is_below(c, POLICY.adoption.min_friction_wave)
}

/// Whether two forms repeat with the same order of the angle.
fn same_order(a: &Form, b: &Form) -> bool {
    matches!((a.order(), b.order()), (Some(a), Some(b)) if (a - b).abs() <= POLICY.adoption.max_order_difference * a)
}

/// Whether a form that wrong values look like may be named beside another effect: only where little else is left that it may
/// take up. Values are named after effects; time is not imitated by what a joint keeps.
fn hides_beside(form: &Form, residue: &Residue<'_>) -> bool {
    match form {
        _ if form.shifts_time() => !residue.any_noisy(),
        _ => form.effect().kind() == Kind::Structure && residue.at_floor(),
    }
}

/// Gain of each of the forms that explain about as much at the noise that the best of them leaves; none of those that do not
/// hold there.
///
/// What a wrong form leaves is small beside a gap but large beside noise. That says something only where the best leaves
/// nothing else, and of forms that are exact: what a simulated gear or bristle misses is not another effect.
fn contest(search: &Search<'_>, forms: &[&Candidate], listener: &mut dyn Listener) -> Option<Vec<Option<f64>>> {
    let exact: Vec<usize> = (0..forms.len()).filter(|i| !forms[*i].form.is_simulated()).collect();
    let mut holds = vec![Some(0.0); forms.len()];
    if exact.len() < 2 {
        return Some(holds);
    }
    let background = &search.design.background;
    let rows: Vec<f64> =
        (0..search.noise.len()).map(|j| background.folds.iter().map(|fold| fold[j].rows).sum()).collect();
    let mut weights = search.weights.clone();
    let mut standings: Vec<Standing> = Vec::new();
    let mut noise = search.noise.clone();
    for _ in 0..CONTEST_ROUNDS {
        let solved = background.solve_scales(&weights, &PRIOR_SCALES, &[]);
        standings = exact
            .iter()
            .map(|i| Search::standing_at(background, *i, forms[*i], &weights, &solved))
            .collect::<Option<Vec<Standing>>>()?;
        let best = standings.iter().max_by(|a, b| a.gain.total_cmp(&b.gain))?;
        let Candidate { cells, local, .. } = forms[best.at];
        let errors: Vec<Vec<f64>> =
            (0..FOLDS).map(|fold| background.fold_errors_with(cells, local, fold, &best.added)).collect();
        for (j, noise) in noise.iter_mut().enumerate() {
            let square: f64 = errors.iter().map(|fold| fold[j]).sum();
            *noise = (square / rows[j].max(1.0)).max(0.0).sqrt().max(search.floor[j]).max(1e-9);
            weights[j] = 1.0 / (noise.powi(2) * search.correlations[j]);
        }
    }
    let best = standings.iter().max_by(|a, b| a.gain.total_cmp(&b.gain))?;
    for standing in &standings {
        holds[standing.at] = Some(standing.gain);
    }
    let joints = forms[best.at].form.joints();
    if joints.is_empty()
        || joints.iter().any(|j| noise[*j] > POLICY.adoption.max_floor_ratio_of_little_left * search.floor[*j])
    {
        return Some(holds);
    }
    for standing in &standings {
        let behind = best.gain - standing.gain;
        if behind > POLICY.adoption.rival_gap {
            holds[standing.at] = None;
            listener.line(&format!("  {:?} leaves more than noise: {behind:.0} behind", forms[standing.at].form));
        }
    }
    Some(holds)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::position_dependent_friction::PositionFriction;
    use crate::effects::torque_ripple::Ripple;

    /// Of a sound arm's slow log: 0.28 N m at 165 cycles a turn about a level that was 2.2 N m off.
    #[test]
    fn friction_over_the_angle_is_a_wave() {
        let form = PositionFriction { joint: 1, order: 164.5 }.into();
        assert!(is_level(&form, &[0.2686, 0.0848, 2.2093]) && !is_level(&form, &[3.0, 1.0, -2.0]));
        assert!(!is_level(&Ripple { joint: 1, order: 8.0 }.into(), &[0.1, 0.0]));
    }
}
