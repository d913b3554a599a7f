//! Comparison of an adopted effect with its rivals once it is in the model.
//!
//! While an effect is chosen the noise of its joint is that of the gap, and rows in which the direction of friction is in doubt count
//! beside it like any others: what two laws of one joint differ by is lost among them. With one of the two in the model the noise has
//! come down to what holds, such rows count for little, and the other one is asked again. It is put in the first one's place for that:
//! what a wrong law leaves is noise as well.

use crate::effects::Form;
use crate::effects::Kind;
use crate::fit::search::{Candidate, Search};
use crate::model::listener::Listener;
use crate::policy::POLICY;
use crate::select::adopted::Adopted;
use crate::select::forward::Selected;

/// Share of what is believed of a coefficient that holds it at nothing.
const HELD_COEFFICIENT_SHARE: f64 = 1e-6;

impl<'a> Selected<'a> {
    /// Holds the last effect against its rivals: those that are clearly behind are none, one that is clearly ahead takes its place.
    /// None where the equations have no solution.
    pub(crate) fn settle(
        &mut self,
        search: &mut Search<'a>,
        candidate: &Candidate,
        listener: &mut dyn Listener,
    ) -> Option<()> {
        let Some(last) = self.adopted.last() else { return Some(()) };
        let exact = |form: &Form| {
            !form.is_simulated()
                && !form.is_nameless()
                && form.effect().kind() == Kind::Structure
                && !form.joints().is_empty()
                && form.joints() == last.form.joints()
        };
        let rivals: Vec<Form> =
            last.rivals.iter().filter(|rival| !rival.is_kept).map(|rival| rival.form.clone()).filter(&exact).collect();
        if !exact(&last.form) {
            return Some(());
        }
        for rival in rivals {
            // What took its place is held against no other: these are the rivals of the first.
            if self.hold_against(search, candidate, &rival, listener)? {
                break;
            }
        }
        Some(())
    }

    /// Whether `rival` took the place of the last effect.
    fn hold_against(
        &mut self,
        search: &mut Search<'a>,
        candidate: &Candidate,
        rival: &Form,
        listener: &mut dyn Listener,
    ) -> Option<bool> {
        let adopted = self.adopted.last()?.clone();
        let noise = |search: &Search<'_>| adopted.form.joints().iter().map(|j| search.noise[*j].powi(2)).sum::<f64>();
        let is_down = |search: &Search<'_>| {
            adopted
                .form
                .joints()
                .iter()
                .all(|j| search.noise[*j] <= POLICY.adoption.max_floor_ratio_of_little_left * search.floor[*j])
        };
        let with_own = noise(search);
        let [mine, its] = self.both(search, [&adopted.form, rival])?;
        let (mut ahead, mut down) = (mine.1 - its.1, is_down(search));
        let adoption = Adopted::new(search, &its.0, &self.physics, its.1)?;
        let adoption = Adopted { place: adopted.place, ..adoption };
        // With the other one in its place.
        search.design.give_up(&adopted.mean);
        if let Some(physics) = search.extend(&its.0, &adoption.mean) {
            if noise(search) < with_own {
                self.adopted.pop();
                self.adopted.push(adoption.clone());
                let before = std::mem::replace(&mut self.physics, physics);
                if let Some([mine, its]) = self.both(search, [&adopted.form, rival]) {
                    (ahead, down) = (mine.1 - its.1, is_down(search));
                }
                self.adopted.pop();
                if down && -ahead > POLICY.adoption.rival_gap {
                    listener.line(&format!(
                        "  {:?} takes the place of {:?}: {:.0} ahead",
                        adoption.form, adopted.form, -ahead
                    ));
                    let rivals = adopted.rivals.into_iter().filter(|r| r.form != *rival).collect();
                    let (shares, share, p_value) = (adopted.shares, adopted.share, adopted.p_value);
                    self.adopted.push(Adopted { shares, share, p_value, rivals, ..adoption });
                    return Some(true);
                }
                self.adopted.push(adopted.clone());
                self.physics = before;
            }
            search.design.give_up(&adoption.mean);
        }
        if search.extend(candidate, &adopted.mean).is_none() {
            self.adopted.pop();
            return None;
        }
        if down && ahead > POLICY.adoption.rival_gap {
            listener.line(&format!("  {rival:?} leaves more than noise: {ahead:.0} behind"));
            self.adopted.last_mut()?.rivals.retain(|r| r.form != *rival);
        }
        Some(false)
    }

    /// Gains of two forms, inner values refined, where the effect that was adopted last is held at nothing.
    fn both(&self, search: &mut Search<'a>, forms: [&Form; 2]) -> Option<[(Candidate, f64); 2]> {
        let last = self.adopted.last()?;
        let free = search.design.background.std.clone();
        let columns = last.place..free.len();
        search.design.background.std.rows_mut(columns.start, columns.len()).scale_mut(HELD_COEFFICIENT_SHARE);
        let scales = search.scales();
        let gain = |form: &Form| {
            let (candidate, standing) = search.refine_over(form, &self.physics, &scales)?;
            Some((candidate, standing.gain))
        };
        let gains = forms.map(gain);
        search.design.background.std = free;
        let [one, other] = gains;
        Some([one?, other?])
    }
}
