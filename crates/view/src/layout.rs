//! The layout of Foxglove for a robot: panels, and the paths of what they show.
//!
//! The format has no public specification. It is that of layouts which Foxglove exports: panels by id in `configById`, and a tree
//! of ids in `layout`. A path is a topic in quotes, then fields and places (`"rivet/dd2/residual".residual[0]`).

use serde_json::{Map, Value, json};

/// Colours of series, one after the other.
const COLOURS: [&str; 8] = ["#4e98e2", "#f5774d", "#f7df71", "#5cd6a9", "#a395e2", "#e2659a", "#8fc93a", "#b0b0b0"];

/// The layout as a file.
pub fn text(robot: &str, joints: &[String], parameters: &[(String, &str)]) -> String {
    format!("{:#}\n", layout(robot, joints, parameters))
}

/// The layout for a robot: names of its joints, names and units of its base parameters.
pub fn layout(robot: &str, joints: &[String], parameters: &[(String, &str)]) -> Value {
    let mut panels = Panels { robot, by_id: Map::new() };
    let friction = panels.friction(joints);
    let parameters = panels.parameters(parameters);
    let residuals = panels.residuals(joints);
    let states = panels.states();
    let log = panels.log();
    let motion = panels.motion(joints);
    let split = |direction: &str, first: &Value, second: &Value, percent: u32| json!({"direction": direction, "first": first, "second": second, "splitPercentage": percent});
    let left_column = split("column", &friction, &parameters, 50);
    let upper = split("column", &residuals, &motion, 50);
    let lower = split("column", &states, &log, 60);
    let right_column = split("column", &upper, &lower, 55);
    json!({
        "configById": panels.by_id,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": split("row", &left_column, &right_column, 50),
    })
}

struct Panels<'a> {
    robot: &'a str,
    by_id: Map<String, Value>,
}

/// A line of a plot.
fn series(path: &str, label: &str, colour: usize, width: f64) -> Value {
    json!({"value": path, "enabled": true, "timestampMethod": "receiveTime", "label": label,
           "color": COLOURS[colour % COLOURS.len()], "showLine": true, "lineSize": width})
}

impl Panels<'_> {
    /// A path in a topic. Quotes: names of robots and topics have hyphens.
    fn path(&self, topic: &str, rest: &str) -> String {
        format!("\"rivet/{}/{topic}\"{rest}", self.robot)
    }

    /// Adds a panel; its id. The title has a key in Foxglove and one in its open-source relative.
    fn add(&mut self, kind: &str, id: &str, title: &str, mut config: Value) -> Value {
        for key in ["foxglovePanelTitle", "lichtblickPanelTitle"] {
            config[key] = title.into();
        }
        let id = format!("{kind}!{id}");
        self.by_id.insert(id.clone(), config);
        id.into()
    }

    fn tabs(&mut self, id: &str, title: &str, tabs: &[(String, Value)]) -> Value {
        let tabs: Vec<Value> = tabs.iter().map(|(title, panel)| json!({"title": title, "layout": panel})).collect();
        self.add("Tab", id, title, json!({"activeTabIdx": 0, "tabs": tabs}))
    }

    /// Values over time.
    fn plot(&mut self, id: &str, title: &str, unit: &str, paths: &[Value]) -> Value {
        let config = json!({"paths": paths, "xAxisVal": "timestamp", "showXAxisLabels": true, "showYAxisLabels": true,
                            "showLegend": true, "legendDisplay": "left", "showPlotValuesInLegend": true, "isSynced": true,
                            "sidebarDimension": 200, "followingViewWidth": 30, "yAxisLabel": unit});
        self.add("Plot", id, title, config)
    }

    /// Friction over speed, a tab a joint.
    fn friction(&mut self, joints: &[String]) -> Value {
        let mut tabs = Vec::new();
        for (j, joint) in joints.iter().enumerate() {
            let path = |field: &str| self.path("friction-curve", &format!(".joints[{j}].{field}[:]"));
            let paths = [
                series(&path("torque"), "estimate", 0, 2.0),
                series(&path("lower"), "- 2 sigma", 0, 0.75),
                series(&path("upper"), "+ 2 sigma", 0, 0.75),
                series(&path("nominal"), "robot file", 7, 1.0),
            ];
            let config = json!({"paths": paths, "xAxisVal": "currentCustom",
                                "xAxisPath": {"value": path("speed"), "enabled": true}, "showXAxisLabels": true,
                                "showYAxisLabels": true, "showLegend": true, "legendDisplay": "floating",
                                "showPlotValuesInLegend": false, "isSynced": false, "sidebarDimension": 200,
                                "xAxisLabel": "speed [rad/s, or m/s]", "yAxisLabel": "friction torque [N m, or N]"});
            let title = format!("Friction of {joint}");
            tabs.push((joint.clone(), self.add("Plot", &format!("friction-{}", j + 1), &title, config)));
        }
        self.tabs("friction", "Friction", &tabs)
    }

    /// Parameters with two standard deviations to each side, a tab a unit; the table and the supervision beside them.
    fn parameters(&mut self, parameters: &[(String, &str)]) -> Value {
        let mut units: Vec<&str> = Vec::new();
        for (_, unit) in parameters {
            if !units.contains(unit) {
                units.push(unit);
            }
        }
        let mut tabs = Vec::new();
        for (u, unit) in units.iter().enumerate() {
            let mut paths = Vec::new();
            let of_unit = parameters.iter().enumerate().filter(|(_, (_, other))| other == unit);
            for (colour, (i, (name, _))) in of_unit.enumerate() {
                let path = |field: &str| self.path("parameter-band", &format!(".parameters[{i}].{field}"));
                paths.push(series(&path("value"), name, colour, 2.0));
                paths.push(series(&path("lower"), &format!("{name} - 2 sigma"), colour, 0.75));
                paths.push(series(&path("upper"), &format!("{name} + 2 sigma"), colour, 0.75));
            }
            let panel = self.plot(&format!("parameters-{}", u + 1), &format!("Parameters [{unit}]"), unit, &paths);
            tabs.push(((*unit).to_owned(), panel));
        }
        let table = json!({"topicPath": self.path("parameter-band", ".parameters")});
        tabs.push(("table".to_owned(), self.add("Table", "parameters", "Parameters", table)));
        let state = |(i, (name, _)): (usize, &(String, &str))| {
            let path = self.path("parameter-band", &format!(".parameters[{i}].state"));
            json!({"value": path, "label": name, "enabled": true, "timestampMethod": "receiveTime"})
        };
        let paths: Vec<Value> = parameters.iter().enumerate().map(state).collect();
        let config = json!({"paths": paths, "isSynced": true, "showPoints": false});
        let panel = self.add("StateTransitions", "supervision", "Supervision of each parameter", config);
        tabs.push(("supervision".to_owned(), panel));
        self.tabs("parameters", "Parameters", &tabs)
    }

    /// A line a joint of each of some fields of a topic.
    fn of_joints(&self, topic: &str, fields: &[(&str, &str, f64)], joints: &[String]) -> Vec<Value> {
        let mut paths = Vec::new();
        for (j, joint) in joints.iter().enumerate() {
            for (field, word, width) in fields {
                let label = if word.is_empty() { joint.clone() } else { format!("{joint} {word}") };
                paths.push(series(&self.path(topic, &format!(".{field}[{j}]")), &label, j, *width));
            }
        }
        paths
    }

    fn residuals(&mut self, joints: &[String]) -> Value {
        let estimated = self.of_joints("residual", &[("residual", "", 1.0)], joints);
        let nominal = self.of_joints("residual", &[("nominal_residual", "", 1.0)], joints);
        let torque =
            self.of_joints("residual", &[("torque", "measured", 2.0), ("predicted", "predicted", 0.75)], joints);
        let rms = self.of_joints("health", &[("residual_rms", "", 1.5)], joints);
        let unit = "[N m, or N]";
        let tabs = [
            ("estimate", "Measured minus predicted torque", estimated),
            ("robot file", "Measured minus the robot file's torque", nominal),
            ("torque", "Measured and predicted torque", torque),
            ("RMS", "RMS residual of the window", rms),
        ];
        let mut made = Vec::new();
        for (i, (tab, title, paths)) in tabs.iter().enumerate() {
            made.push(((*tab).to_owned(), self.plot(&format!("residuals-{}", i + 1), title, unit, paths)));
        }
        self.tabs("residuals", "Residual torque", &made)
    }

    fn motion(&mut self, joints: &[String]) -> Value {
        let mut q = self.of_joints("joint-state", &[("q", "measured", 1.5)], joints);
        q.extend(self.of_joints("setpoint", &[("q", "planned", 0.75)], joints));
        let tau = self.of_joints("joint-state", &[("tau", "", 1.0)], joints);
        let tabs = [
            ("position".to_owned(), self.plot("positions", "Joint positions", "[rad, or m]", &q)),
            ("torque".to_owned(), self.plot("torques", "Torque of the drives", "[N m, or N]", &tau)),
        ];
        self.tabs("motion", "Motion", &tabs)
    }

    fn states(&mut self) -> Value {
        let rows = [
            ("daemon", "rivetd"),
            ("input_fault", "input fault"),
            ("load", "load level"),
            ("instruments", "instruments"),
            ("drift", "accepted model"),
            ("controller", "rivet-controller"),
            ("stop_cause", "last stop"),
            ("parameter_source", "parameters in use"),
        ];
        let path = |(field, label): (&str, &str)| {
            let value = self.path("state", &format!(".{field}"));
            json!({"value": value, "label": label, "enabled": true, "timestampMethod": "receiveTime"})
        };
        let paths: Vec<Value> = rows.into_iter().map(path).collect();
        let config = json!({"paths": paths, "isSynced": true, "showPoints": false});
        self.add("StateTransitions", "states", "States of rivetd and rivet-controller", config)
    }

    fn log(&mut self) -> Value {
        let topic = format!("rivet/{}/log", self.robot);
        let config = json!({"topicToRender": topic, "minLogLevel": 1, "searchTerms": []});
        let log = self.add("RosOut", "log", "Stops and changes of state", config);
        let table = json!({"topicPath": self.path("state", "")});
        let table = self.add("Table", "states", "States", table);
        self.tabs("log", "Log", &[("log".to_owned(), log), ("states".to_owned(), table)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// Ids of panels below a place of the tree, tabs with what is in them.
    fn shown(node: &Value, by_id: &Map<String, Value>, found: &mut Vec<String>) {
        match node {
            Value::String(id) => {
                found.push(id.clone());
                for tab in by_id[id]["tabs"].as_array().into_iter().flatten() {
                    shown(&tab["layout"], by_id, found);
                }
            }
            node => {
                assert!(["row", "column"].contains(&node["direction"].as_str().expect("a direction")));
                shown(&node["first"], by_id, found);
                shown(&node["second"], by_id, found);
            }
        }
    }

    #[test]
    fn every_panel_is_shown_once_and_every_joint_and_parameter_has_its_series() {
        let joints = ["shoulder".to_owned(), "elbow".to_owned()];
        let parameters =
            [("j1.coulomb".to_owned(), "N m"), ("l1.Izz".to_owned(), "kg m^2"), ("j2.coulomb".to_owned(), "N m")];
        let layout = layout("two-link", &joints, &parameters);
        let by_id = layout["configById"].as_object().expect("panels");
        let mut found = Vec::new();
        shown(&layout["layout"], by_id, &mut found);
        assert_eq!(found.len(), found.iter().collect::<BTreeSet<_>>().len(), "{found:?}");
        assert_eq!(found.iter().collect::<BTreeSet<_>>(), by_id.keys().collect::<BTreeSet<_>>());
        let lengths = ["Plot!friction-2", "Plot!parameters-1", "Plot!residuals-1", "StateTransitions!supervision"];
        let lengths = lengths.map(|id| by_id[id]["paths"].as_array().map(Vec::len));
        assert_eq!(lengths, [Some(4), Some(6), Some(2), Some(3)]);
        assert_eq!(by_id["Plot!residuals-1"]["paths"][1]["value"], "\"rivet/two-link/residual\".residual[1]");
    }
}
