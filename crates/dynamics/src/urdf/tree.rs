//! From a tree of links to the chain that is modelled: what belongs to the arm, and what is welded to it.

use std::collections::HashMap;

use super::error::{UrdfError, UrdfMistake};
use super::options::{Proposal, UrdfOptions};
use super::text::{File, Joint};
use crate::arm::MAX_JOINTS;

/// A side branch of at most so many joints at the end of an arm may be a gripper.
const GRIPPER_JOINTS: usize = 2;
/// An arm has at least so many joints before a gripper.
const ARM_JOINTS: usize = 3;
/// A joint follows another through at most so many followers.
const MAX_FOLLOWERS: usize = 64;
/// So many names are listed in a message.
const MAX_LISTED: usize = 40;
/// Beginnings of what joints and links of grippers are called.
const GRIPPER_WORDS: [&str; 7] = ["finger", "grip", "jaw", "claw", "knuckle", "thumb", "pincer"];
/// What the last link of an arm is called, in the order of preference.
const TOOL_WORDS: [&str; 3] = ["tool0", "tcp", "flange"];

/// Links and joints of a file, known to be trees.
pub(super) struct Tree<'a> {
    pub(super) file: &'a File,
    links: HashMap<&'a str, usize>,
    joints: HashMap<&'a str, usize>,
    /// Joints below each link, in file order.
    pub(super) children: Vec<Vec<usize>>,
    /// The joint above each link.
    parent: Vec<Option<usize>>,
    /// Links above and below each joint.
    above: Vec<usize>,
    pub(super) below: Vec<usize>,
    /// Links, those nearer the roots first.
    order: Vec<usize>,
    roots: Vec<usize>,
}

/// What is modelled of a tree.
pub(super) struct Chain {
    pub(super) root: usize,
    /// Moving joints, base to tip.
    pub(super) joints: Vec<usize>,
    /// Moving joints that are welded, by joint.
    pub(super) welds: HashMap<usize, f64>,
    /// Those of them that the caller did not name.
    pub(super) assumed: Vec<usize>,
}

impl<'a> Tree<'a> {
    /// The trees of a file; none after a mistake.
    pub(super) fn new(file: &'a File, mistakes: &mut Vec<UrdfMistake>) -> Option<Tree<'a>> {
        let before = mistakes.len();
        let mut fail = |line: usize, error: UrdfError| mistakes.push(UrdfMistake { line, error });
        let mut links = HashMap::new();
        for (i, link) in file.links.iter().enumerate() {
            if links.insert(link.name.as_str(), i).is_some() {
                fail(link.line, UrdfError::Duplicate { what: "link", name: link.name.clone() });
            }
        }
        let n = file.links.len();
        let mut names: HashMap<&str, usize> = HashMap::new();
        let (mut children, mut parent) = (vec![Vec::new(); n], vec![None; n]);
        let (mut above, mut below) = (Vec::new(), Vec::new());
        for (j, joint) in file.joints.iter().enumerate() {
            if names.insert(joint.name.as_str(), j).is_some() {
                fail(joint.line, UrdfError::Duplicate { what: "joint", name: joint.name.clone() });
            }
            let mut find = |link: &String| {
                let found = links.get(link.as_str()).copied();
                if found.is_none() {
                    let (joint_name, link) = (joint.name.clone(), link.clone());
                    fail(joint.line, UrdfError::UnknownLink { joint: joint_name, link });
                }
                found.unwrap_or(0)
            };
            let (from, to) = (find(&joint.parent), find(&joint.child));
            above.push(from);
            below.push(to);
            if !links.contains_key(joint.child.as_str()) || !links.contains_key(joint.parent.as_str()) {
                continue;
            }
            if let Some(first) = parent[to] {
                let first: &Joint = &file.joints[first];
                let (link, first, second) = (joint.child.clone(), first.name.clone(), joint.name.clone());
                fail(joint.line, UrdfError::SecondParent { link, first, second });
                continue;
            }
            parent[to] = Some(j);
            children[from].push(j);
        }
        let roots: Vec<usize> = (0..n).filter(|&i| parent[i].is_none()).collect();
        let mut order = roots.clone();
        let mut next = 0;
        while let Some(&link) = order.get(next) {
            order.extend(children[link].iter().map(|&j: &usize| below[j]));
            next += 1;
        }
        if order.len() < n && mistakes.len() == before {
            let link = looped(&order, &parent, &above);
            let (name, line) = (file.links[link].name.clone(), file.links[link].line);
            mistakes.push(UrdfMistake { line, error: UrdfError::Loop { link: name } });
        }
        (mistakes.len() == before).then_some(Tree {
            file,
            links,
            joints: names,
            children,
            parent,
            above,
            below,
            order,
            roots,
        })
    }

    /// The chain that `options` ask for; mistakes where there is none.
    pub(super) fn chain(&self, options: &UrdfOptions, mistakes: &mut Vec<UrdfMistake>) -> Option<Chain> {
        let before = mistakes.len();
        let mut welds = HashMap::new();
        for (name, value) in &options.fixed {
            let Some(&j) = self.joints.get(name.as_str()) else {
                let moving = self.file.joints.iter().filter(|j| j.kind != "fixed").map(|j| j.name.clone());
                let joints = moving.take(MAX_LISTED).collect();
                mistakes.push(UrdfMistake { line: 0, error: UrdfError::NoFixed { joint: name.clone(), joints } });
                continue;
            };
            if self.file.joints[j].kind != "fixed" {
                welds.insert(j, *value);
            }
        }
        let fail = |mistakes: &mut Vec<UrdfMistake>, line: usize, error| mistakes.push(UrdfMistake { line, error });
        let (root, joints) = if let Some(tip) = &options.tip {
            let Some(&tip) = self.links.get(tip.as_str()) else {
                let (tip, proposal) = (tip.clone(), Box::new(self.propose(&welds)));
                fail(mistakes, 0, UrdfError::NoTip { tip, proposal });
                return None;
            };
            self.path(tip, &welds)
        } else {
            self.only_chain(&welds, mistakes)?
        };
        let moving =
            |j: &&usize| !matches!(self.file.joints[**j].kind.as_str(), "revolute" | "continuous" | "prismatic");
        for &j in joints.iter().filter(moving) {
            let joint = &self.file.joints[j];
            let error = UrdfError::UnsupportedJoint { joint: joint.name.clone(), kind: joint.kind.clone() };
            fail(mistakes, joint.line, error);
        }
        let followers: Vec<usize> = joints.iter().copied().filter(|&j| self.follows(j)).take(MAX_LISTED).collect();
        let proposed = if followers.is_empty() { Proposal::default() } else { self.propose(&welds) };
        for j in followers {
            let joint = &self.file.joints[j];
            if let Some(mimic) = &joint.mimic {
                let proposal = Box::new(proposed.clone());
                let (of, name) = (mimic.joint.clone(), joint.name.clone());
                fail(mistakes, joint.line, UrdfError::Mimic { joint: name, of, proposal });
            }
        }
        match joints.len() {
            0 => fail(mistakes, 0, UrdfError::NoJoints),
            count if count > MAX_JOINTS => {
                let proposal = Box::new(self.propose(&welds));
                fail(mistakes, 0, UrdfError::TooManyJoints { count, proposal });
            }
            _ => {}
        }
        if mistakes.len() > before {
            return None;
        }
        let assumed = self.sides(&joints, &welds);
        let places: Vec<f64> = assumed.iter().map(|&j| self.rest(j, &welds)).collect();
        welds.extend(assumed.iter().copied().zip(places));
        Some(Chain { root, joints, welds, assumed })
    }

    fn rigid(&self, joint: usize, welds: &HashMap<usize, f64>) -> bool {
        self.file.joints[joint].kind == "fixed" || welds.contains_key(&joint)
    }

    /// Root and moving joints above a link.
    fn path(&self, tip: usize, welds: &HashMap<usize, f64>) -> (usize, Vec<usize>) {
        let (mut link, mut joints) = (tip, Vec::new());
        while let Some(joint) = self.parent[link] {
            if !self.rigid(joint, welds) {
                joints.push(joint);
            }
            link = self.above[joint];
        }
        joints.reverse();
        (link, joints)
    }

    /// Root and moving joints where each moving body carries one moving joint at most.
    fn only_chain(&self, welds: &HashMap<usize, f64>, mistakes: &mut Vec<UrdfMistake>) -> Option<(usize, Vec<usize>)> {
        let name = |link: usize| self.file.links[link].name.clone();
        let Some(&root) = self.roots.first() else {
            mistakes.push(UrdfMistake { line: 0, error: UrdfError::NoJoints });
            return None;
        };
        if let Some(&other) = self.roots.get(1) {
            let proposal = Box::new(self.propose(welds));
            let error = UrdfError::SeveralRoots { first: name(root), second: name(other), proposal };
            mistakes.push(UrdfMistake { line: self.file.links[other].line, error });
            return None;
        }
        let (mut carrier, mut joints) = (root, Vec::new());
        loop {
            let moving = self.moving_on(carrier, welds).1;
            match moving[..] {
                [] => return Some((root, joints)),
                [joint] => {
                    joints.push(joint);
                    carrier = self.below[joint];
                }
                [first, second, ..] => {
                    let of = |j: usize| self.file.joints[j].name.clone();
                    let proposal = Box::new(self.propose(welds));
                    let error =
                        UrdfError::Branches { link: name(carrier), first: of(first), second: of(second), proposal };
                    mistakes.push(UrdfMistake { line: self.file.joints[second].line, error });
                    return None;
                }
            }
        }
    }

    /// Links that move as one with `carrier`, and the moving joints on them, in file order.
    fn moving_on(&self, carrier: usize, welds: &HashMap<usize, f64>) -> (Vec<usize>, Vec<usize>) {
        let (mut links, mut moving, mut next) = (vec![carrier], Vec::new(), 0);
        while let Some(&link) = links.get(next) {
            next += 1;
            for &joint in &self.children[link] {
                if self.rigid(joint, welds) {
                    links.push(self.below[joint]);
                } else {
                    moving.push(joint);
                }
            }
        }
        moving.sort_unstable();
        (links, moving)
    }

    /// Moving joints beside a chain whose place changes a body of it; those that stand on the root move no body that does.
    fn sides(&self, chain: &[usize], welds: &HashMap<usize, f64>) -> Vec<usize> {
        let mut open: Vec<usize> = chain.iter().map(|&j| self.below[j]).collect();
        let mut found = Vec::new();
        while let Some(link) = open.pop() {
            for &joint in self.children[link].iter().filter(|joint| !chain.contains(joint)) {
                if !self.rigid(joint, welds) {
                    found.push(joint);
                }
                open.push(self.below[joint]);
            }
        }
        // What is fixed to the root up to a joint of the chain decides where that is.
        for (k, &joint) in chain.iter().enumerate() {
            let stop = k.checked_sub(1).map(|k| self.below[chain[k]]);
            let mut link = self.above[joint];
            while Some(link) != stop
                && let Some(joint) = self.parent[link]
            {
                if !self.rigid(joint, welds) && !found.contains(&joint) {
                    found.push(joint);
                }
                link = self.above[joint];
            }
        }
        found.sort_unstable();
        found
    }

    /// Where a joint is welded that nobody gave a place: at 0, or at the limit next to it; a follower where the joint is that it follows.
    fn rest(&self, joint: usize, welds: &HashMap<usize, f64>) -> f64 {
        let mut followed = joint;
        let (mut factor, mut offset) = (1.0, 0.0);
        // Followers may follow each other.
        for _ in 0..MAX_FOLLOWERS {
            let Some(mimic) = &self.file.joints[followed].mimic else { break };
            let Some(&next) = self.joints.get(mimic.joint.as_str()) else { break };
            offset += factor * mimic.offset;
            factor *= mimic.multiplier;
            followed = next;
        }
        let limit = &self.file.joints[followed].limit;
        let limited = self.file.joints[followed].kind != "continuous" && limit.lower < limit.upper;
        let zero = if limited { 0.0_f64.clamp(limit.lower, limit.upper) } else { 0.0 };
        let value = factor * welds.get(&followed).copied().unwrap_or(zero) + offset;
        if value.is_finite() { value } else { 0.0 }
    }

    /// The most probable arm in the trees: the longest chain, without what looks like a gripper at its end.
    pub(super) fn propose(&self, given: &HashMap<usize, f64>) -> Proposal {
        let length = self.lengths();
        let of_root = |&root: &usize| self.children[root].iter().map(|&j| length[j]).max().unwrap_or(0);
        let Some(&root) = self.roots.iter().rev().max_by_key(|root| of_root(root)) else { return Proposal::default() };
        let mut welds = given.clone();
        let (mut carrier, mut chain) = (root, Vec::new());
        loop {
            let moving = self.moving_on(carrier, &welds).1;
            let Some(best) = self.next_of_arm(&moving, &length, chain.len()) else { break };
            if self.follows(best) || !self.supported(best) {
                welds.insert(best, self.rest(best, given));
                continue;
            }
            chain.push(best);
            carrier = self.below[best];
        }
        if chain.is_empty() {
            return Proposal::default();
        }
        // Rails and trunks come before arms.
        let extra = chain.len().saturating_sub(MAX_JOINTS);
        for joint in chain.drain(..extra) {
            welds.insert(joint, self.rest(joint, given));
        }
        let (links, _) = self.moving_on(carrier, &welds);
        let tip = TOOL_WORDS.iter().find_map(|word| {
            links.iter().copied().find(|&link| self.file.links[link].name.to_lowercase().contains(word))
        });
        let mut fixed = self.sides(&chain, given);
        fixed.extend(given.keys().copied());
        fixed.sort_unstable();
        let at = |j: usize| {
            (self.file.joints[j].name.clone(), given.get(&j).copied().unwrap_or_else(|| self.rest(j, given)))
        };
        let tip = self.file.links[tip.unwrap_or(carrier)].name.clone();
        Proposal { tip, fixed: fixed.into_iter().map(at).collect() }
    }

    /// Joints of the longest chain that begins with each joint; followers do not count.
    fn lengths(&self) -> Vec<usize> {
        let mut length = vec![0; self.file.joints.len()];
        for &link in self.order.iter().rev() {
            if let Some(joint) = self.parent[link] {
                let below = self.children[link].iter().map(|&j| length[j]).max().unwrap_or(0);
                length[joint] = below + usize::from(self.supported(joint) && !self.follows(joint));
            }
        }
        length
    }

    fn supported(&self, joint: usize) -> bool {
        matches!(self.file.joints[joint].kind.as_str(), "revolute" | "continuous" | "prismatic")
    }

    fn follows(&self, joint: usize) -> bool {
        self.file.joints[joint].mimic.is_some()
    }

    /// The joint with which an arm of `joints` joints goes on, of those on its last body.
    fn next_of_arm(&self, moving: &[usize], length: &[usize], joints: usize) -> Option<usize> {
        let longest = moving.iter().map(|&j| length[j]).max().filter(|longest| *longest > 0)?;
        let best = moving.iter().copied().find(|&j| length[j] == longest)?;
        if joints >= ARM_JOINTS && longest <= GRIPPER_JOINTS {
            let alike = moving.iter().filter(|&&j| length[j] == longest).count() > 1;
            let led = self.file.joints.iter().filter_map(|j| j.mimic.as_ref());
            // One that leads a follower on the way to a further joint is of a wrist.
            let leads = longest == 1 && led.map(|mimic| &mimic.joint).any(|of| *of == self.file.joints[best].name);
            if alike || leads || moving.iter().any(|&j| self.of_gripper(j, length[j])) {
                return None;
            }
        }
        Some(best)
    }

    /// Whether a joint has the name of a gripper's. The name of its link counts where nothing moves on it: a wrist may carry `gripper_link`.
    fn of_gripper(&self, joint: usize, length: usize) -> bool {
        let named = |name: &str| GRIPPER_WORDS.iter().any(|word| name.to_lowercase().contains(word));
        named(&self.file.joints[joint].name) || (length <= 1 && named(&self.file.links[self.below[joint]].name))
    }
}

/// A link of a loop, the first of the file: what no root reaches hangs on one.
fn looped(reached: &[usize], parent: &[Option<usize>], above: &[usize]) -> usize {
    let mut seen = vec![false; parent.len()];
    for &link in reached {
        seen[link] = true;
    }
    let up = |link: usize| parent[link].map_or(link, |joint: usize| above[joint]);
    let mut link = (0..parent.len()).find(|&link| !seen[link]).unwrap_or(0);
    for _ in 0..parent.len() {
        link = up(link);
    }
    let (start, mut first) = (link, link);
    for _ in 0..parent.len() {
        link = up(link);
        first = first.min(link);
        if link == start {
            break;
        }
    }
    first
}
