//! Torque that drops out: zeros of all joints at once between others are samples that were lost on their way, and would weigh like any
//! other.

use rivet_dynamics::MAX_JOINTS;

/// Most samples of a torque that drops out; longer, the drives are off.
pub(crate) const LONGEST: usize = 5;

/// The last torques that did not drop out \[N m\], the latest last, and for how many samples there has been none.
#[derive(Clone, Debug, Default)]
pub(crate) struct Dropouts {
    last: [[f64; MAX_JOINTS]; 3],
    lost: usize,
}

impl Dropouts {
    /// The torque of a sample; while it drops out, the median of the three before: a glitch before zeros does not go on. One joint alone may
    /// carry nothing. At most [`MAX_JOINTS`] joints.
    pub(crate) fn bridge(&mut self, tau: &[f64]) -> [f64; MAX_JOINTS] {
        let none = tau.len() > 1 && tau.iter().all(|tau| *tau == 0.0);
        self.lost = if none { self.lost + 1 } else { 0 };
        let mut torque = [0.0; MAX_JOINTS];
        if none && self.lost <= LONGEST {
            let [a, b, c] = &self.last;
            for (j, torque) in torque.iter_mut().enumerate() {
                *torque = a[j].min(b[j]).max(a[j].max(b[j]).min(c[j]));
            }
            return torque;
        }
        torque.iter_mut().zip(tau).for_each(|(torque, tau)| *torque = *tau);
        self.last.rotate_left(1);
        self.last[2] = torque;
        torque
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lost_samples_go_on_as_before_and_a_glitch_does_not() {
        let mut dropouts = Dropouts::default();
        let mut bridge = |tau: [f64; 2]| {
            let torque = dropouts.bridge(&tau);
            [torque[0], torque[1]]
        };
        assert_eq!(bridge([0.0; 2]), [0.0; 2], "nothing to go on with");
        for tau in [[3.0, -1.0], [3.1, -1.1], [900.0, -1.2]] {
            assert_eq!(bridge(tau), tau);
        }
        for _ in 0..LONGEST {
            assert_eq!(bridge([0.0; 2]), [3.1, -1.1]);
        }
        assert_eq!(bridge([0.0; 2]), [0.0; 2], "the drives are off");
        assert_eq!(bridge([0.0, 2.0]), [0.0, 2.0], "one joint may carry nothing");
        let mut alone = Dropouts::default();
        alone.bridge(&[3.0]);
        assert_eq!(alone.bridge(&[0.0])[0], 0.0, "one joint that carries nothing is no news");
    }
}
