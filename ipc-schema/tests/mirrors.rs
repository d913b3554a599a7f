//! The C header and the Python mirror say the same as the Rust messages.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use rivet_ipc_schema::{
    DRIFT_REGIMES, ENUMERATIONS, HISTOGRAM_BINS, INPUT_FAULTS, MAX_JOINTS, MAX_PARAMETERS, MESSAGES, PHASES, REFUSALS,
    REPLY_TEXT, STOP_CAUSES, WORST_PERIODS, faults, parameter_flags,
};

fn path(relative: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(relative)
}

fn text(relative: &str) -> String {
    std::fs::read_to_string(path(relative)).expect("a file of this crate")
}

/// `JointState` -> `joint_state`
fn snake(name: &str) -> String {
    name.char_indices().fold(String::new(), |mut snake, (i, letter)| {
        if letter.is_ascii_uppercase() && i > 0 {
            snake.push('_');
        }
        snake.push(letter.to_ascii_lowercase());
        snake
    })
}

fn bits() -> [(&'static str, u32); 9] {
    [
        ("FAULT_ENCODER", faults::ENCODER),
        ("FAULT_TORQUE", faults::TORQUE),
        ("FAULT_STOPPED", faults::STOPPED),
        ("FAULT_OTHER", faults::OTHER),
        ("FLAG_SUSPENDED", parameter_flags::SUSPENDED),
        ("FLAG_FROZEN", parameter_flags::FROZEN),
        ("FLAG_PROVISIONAL", parameter_flags::PROVISIONAL),
        ("FLAG_BAD_INPUT", parameter_flags::BAD_INPUT),
        ("FLAG_LATE", parameter_flags::LATE),
    ]
}

/// The assertions that the header must contain; compiling it then proves its structs.
#[test]
fn the_header_asserts_the_layout_of_every_message() {
    let header = text("include/rivet.h");
    for message in MESSAGES {
        let (_, version) = message.type_name.rsplit_once(".v").expect("a version");
        let (name, c_name) = (snake(message.name), format!("rivet_{}_v{version}", snake(message.name)));
        let mut expected = format!("}} {c_name};\nRIVET_ASSERT(sizeof({c_name}) == {});\n", message.size);
        for (field, offset) in message.fields {
            writeln!(expected, "RIVET_ASSERT(offsetof({c_name}, {field}) == {offset});").expect("a string");
        }
        assert!(header.contains(&expected), "include/rivet.h must contain\n{expected}");
        let type_name = format!("#define RIVET_{}_TYPE_NAME \"{}\"\n", name.to_uppercase(), message.type_name);
        assert!(header.contains(&type_name), "include/rivet.h must contain\n{type_name}");
        assert_eq!(header.matches(&format!("offsetof({c_name},")).count(), message.fields.len(), "{c_name}");
    }
}

#[test]
fn the_header_has_every_number() {
    let header = text("include/rivet.h");
    let has = |line: &str| assert!(header.contains(line), "include/rivet.h must contain\n{line}");
    has(&format!("#define RIVET_MAX_JOINTS {MAX_JOINTS}\n"));
    has(&format!("#define RIVET_MAX_PARAMETERS {MAX_PARAMETERS}\n"));
    has(&format!("#define RIVET_HISTOGRAM_BINS {HISTOGRAM_BINS}\n"));
    has(&format!("#define RIVET_REFUSALS {REFUSALS}\n"));
    has(&format!("#define RIVET_STOP_CAUSES {STOP_CAUSES}\n"));
    has(&format!("#define RIVET_REPLY_TEXT {REPLY_TEXT}\n"));
    has(&format!("#define RIVET_INPUT_FAULTS {INPUT_FAULTS}\n"));
    has(&format!("#define RIVET_PHASES {PHASES}\n"));
    has(&format!("#define RIVET_DRIFT_REGIMES {DRIFT_REGIMES}\n"));
    has(&format!("#define RIVET_WORST_PERIODS {WORST_PERIODS}\n"));
    has(&format!("#define RIVET_FLAG_LOAD_SHIFT {}\n", parameter_flags::LOAD_SHIFT));
    for (name, bit) in bits() {
        has(&format!("#define RIVET_{name} (UINT32_C(1) << {})\n", bit.ilog2()));
    }
    for enumeration in ENUMERATIONS {
        let prefix = format!("RIVET_{}_", snake(enumeration.name).to_uppercase());
        for (variant, value) in enumeration.values {
            has(&format!("    {prefix}{} = {value},\n", snake(variant).to_uppercase()));
        }
        assert_eq!(header.matches(&format!("    {prefix}")).count(), enumeration.values.len(), "{prefix}");
    }
}

#[test]
fn the_header_compiles_as_c_and_as_cpp() {
    for (compiler, language, standard) in [("cc", "c", "c11"), ("c++", "c++", "c++17")] {
        let run = Command::new(compiler)
            .args(["-x", language, &format!("-std={standard}"), "-Wall", "-Wextra", "-Werror", "-pedantic"])
            // A header compiled by itself would be told that a pragma for inclusion is missing; include it instead.
            .args(["-fsyntax-only", "-include"])
            .arg(path("include/rivet.h"))
            .arg("/dev/null")
            .output();
        match run {
            Ok(run) => assert!(run.status.success(), "{compiler}: {}", String::from_utf8_lossy(&run.stderr)),
            Err(why) => eprintln!("skipped: {compiler} does not run ({why}); the header's struct layout is not proven"),
        }
    }
}

#[test]
fn the_python_mirror_has_the_layout_of_every_message() {
    let mirror = text("python/rivet_ipc.py");
    let mut table = String::from("LAYOUT = {\n");
    for message in MESSAGES {
        writeln!(table, "    {}: ({}, {{", message.name, message.size).expect("a string");
        for (field, offset) in message.fields {
            writeln!(table, "        \"{field}\": {offset},").expect("a string");
        }
        table.push_str("    }),\n");
        let head = format!("    TYPE_NAME = \"{}\"\n    _fields_ = [\n", message.type_name);
        assert!(mirror.contains(&head), "python/rivet_ipc.py must contain\n{head}");
    }
    table.push_str("}\n");
    assert!(mirror.contains(&table), "python/rivet_ipc.py must contain\n{table}");
}

#[test]
fn the_python_mirror_has_every_number() {
    let mirror = text("python/rivet_ipc.py");
    let has = |line: &str| assert!(mirror.contains(line), "python/rivet_ipc.py must contain\n{line}");
    has(&format!("\nMAX_JOINTS = {MAX_JOINTS}\n"));
    has(&format!("\nMAX_PARAMETERS = {MAX_PARAMETERS}\n"));
    has(&format!("\nHISTOGRAM_BINS = {HISTOGRAM_BINS}\n"));
    has(&format!("\nREFUSALS = {REFUSALS}\n"));
    has(&format!("\nSTOP_CAUSES = {STOP_CAUSES}\n"));
    has(&format!("\nREPLY_TEXT = {REPLY_TEXT}\n"));
    has(&format!("\nINPUT_FAULTS = {INPUT_FAULTS}\n"));
    has(&format!("\nPHASES = {PHASES}\n"));
    has(&format!("\nDRIFT_REGIMES = {DRIFT_REGIMES}\n"));
    has(&format!("\nWORST_PERIODS = {WORST_PERIODS}\n"));
    has(&format!("\nFLAG_LOAD_SHIFT = {}\n", parameter_flags::LOAD_SHIFT));
    for (name, bit) in bits() {
        has(&format!("\n{name} = 1 << {}\n", bit.ilog2()));
    }
    for enumeration in ENUMERATIONS {
        let values: Vec<String> =
            enumeration.values.iter().map(|(name, n)| format!("\"{}\": {n}", snake(name))).collect();
        has(&format!("\n{} = {{{}}}\n", snake(enumeration.name).to_uppercase(), values.join(", ")));
    }
}

#[test]
fn python_lays_the_mirror_out_alike() {
    match Command::new("python3").arg("-B").arg(path("python/rivet_ipc.py")).output() {
        Ok(run) => assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr)),
        Err(why) => eprintln!("skipped: python3 does not run ({why}); the layout in ctypes is not proven"),
    }
}
