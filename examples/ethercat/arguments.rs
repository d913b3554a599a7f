//! The command line.

use rivet::BusConfig;

pub(crate) const USAGE: &str = "usage: ethercat TABLE.toml [SAMPLES [PREFIX ROOT]]";

/// What the command line asks for.
#[derive(Debug)]
pub(crate) struct Arguments {
    /// Path of the scaling table.
    pub(crate) table: String,
    /// Samples until the program ends.
    pub(crate) samples: u32,
    pub(crate) bus: BusConfig,
}

/// Reads the arguments after the program's name.
///
/// # Errors
/// What is wrong, and the usage.
pub(crate) fn parse(arguments: &[String]) -> Result<Arguments, String> {
    let wrong = |what: String| Err(format!("{what}\n{USAGE}"));
    if let Some(option) = arguments.first().filter(|first| first.starts_with('-')) {
        return wrong(format!("{option} is no option"));
    }
    let bus = match arguments {
        [_] | [_, _] => BusConfig::default(),
        [_, _, prefix, root] => BusConfig { prefix: prefix.clone(), root: root.into() },
        [] => return wrong("TABLE.toml is missing".into()),
        [_, _, _] => return wrong("ROOT is missing: PREFIX and ROOT name a bus together".into()),
        [_, _, _, _, more, ..] => return wrong(format!("\"{more}\" is one argument too many")),
    };
    let samples = arguments.get(1).map_or("10000", String::as_str);
    match samples.parse() {
        Ok(samples) => Ok(Arguments { table: arguments[0].clone(), samples, bus }),
        Err(_) => wrong(format!("SAMPLES is \"{samples}\"; it must be a whole number, 0 to {}", u32::MAX)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(line: &str) -> Result<Arguments, String> {
        parse(&line.split_whitespace().map(String::from).collect::<Vec<_>>())
    }

    #[test]
    fn arguments_are_table_samples_and_bus() {
        let all = parsed("arm.toml 5 test bus-root").expect("they are right");
        assert_eq!((all.table.as_str(), all.samples), ("arm.toml", 5));
        assert_eq!((all.bus.prefix.as_str(), all.bus.root), ("test", "bus-root".into()));
        let one = parsed("arm.toml").expect("it is right");
        assert_eq!((one.samples, one.bus.prefix), (10_000, BusConfig::default().prefix));
    }

    #[test]
    fn wrong_arguments_are_named_and_the_usage_follows() {
        for (line, message) in [
            ("", "TABLE.toml is missing"),
            ("--verbose", "--verbose is no option"),
            ("arm.toml abc", "SAMPLES is \"abc\"; it must be a whole number, 0 to 4294967295"),
            ("arm.toml -5", "SAMPLES is \"-5\"; it must"),
            ("arm.toml 5 test", "ROOT is missing"),
            ("arm.toml 5 test bus-root more", "\"more\" is one argument too many"),
        ] {
            let why = parsed(line).expect_err(line);
            assert!(why.starts_with(message) && why.ends_with(USAGE), "{line}: {why}");
        }
    }
}
