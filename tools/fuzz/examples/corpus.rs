//! Writes the seeds of the targets whose inputs are not text: `cargo run -p rivet-fuzz --example corpus`.

use rivet_fuzz::STORED;
use rivet_ipc_schema::{ControllerHealth, Drift, Health, Parameters as Set, Timing};
use rivet_store::{Knowledge, Memory, Parameters, Store, Supervision};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// One sample with a plan and second encoders as the target `samples` takes them apart, standing for `stretch` of them.
fn sample(seq: u64, stretch: u8, joints: u32, faults: u32) -> Vec<u8> {
    let mut out = vec![(stretch << 2) | 3];
    let numbers = |out: &mut Vec<u8>, n: usize, scale: f64| {
        for j in 0..n {
            out.extend((scale * (seq as f64 * 0.01 + j as f64).sin()).to_le_bytes());
        }
    };
    for (arrays, tail) in [(3, vec![joints, faults]), (3, vec![joints]), (1, vec![joints])] {
        out.extend(seq.to_le_bytes());
        out.extend((seq * 1_000_000).to_le_bytes());
        for k in 0..arrays {
            numbers(&mut out, 8, 1.0 + 4.0 * f64::from(k));
        }
        for word in tail {
            out.extend(word.to_le_bytes());
        }
    }
    out
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let folder = |name: &str| -> std::io::Result<std::path::PathBuf> {
        fs::create_dir_all(corpus.join(name))?;
        Ok(corpus.join(name))
    };
    for name in ["samples", "parameters"] {
        let folder = folder(name)?;
        let stream: Vec<u8> = (0..20).flat_map(|k| sample(60 * k + 1, 60, 2, 0)).collect();
        fs::write(folder.join("stream"), stream)?;
        fs::write(folder.join("hole"), [sample(1, 60, 2, 0), sample(1000, 60, 2, 0)].concat())?;
        fs::write(folder.join("fault"), [sample(1, 60, 2, 0), sample(61, 60, 2, 1), sample(121, 60, 2, 0)].concat())?;
        fs::write(folder.join("shape"), sample(1, 1, 7, 0))?;
    }
    // An arm that is let go, held, pushed with all there is, and left alone.
    let asked = |periods: u8, joints: u8, mode: u8, behind: u8, tau: f64| {
        let mut out = vec![periods, joints, mode, behind];
        out.extend(tau.to_le_bytes().into_iter().cycle().take(64));
        out
    };
    let released = asked(250, 2, 1, 0, 0.5);
    let commands = folder("command")?;
    fs::write(commands.join("pushed"), [&released[..], &asked(255, 2, 2, 1, 1e9)].concat())?;
    fs::write(commands.join("left"), [&released[..], &asked(20, 2, 0, 0, 0.0), &asked(20, 3, 1, 9, 1.0)].concat())?;
    fs::write(commands.join("no-number"), [&released[..], &asked(20, 2, 1, 0, f64::NAN)].concat())?;
    let control = folder("control")?;
    for command in 0..7_u32 {
        let text = "robot.toml:3:1: name is missing; give it one: \u{fc}".as_bytes();
        let head = [command, command % 4, text.len() as u32].map(u32::to_le_bytes).concat();
        fs::write(control.join(format!("command-{command}")), [&head, text].concat())?;
    }
    // One report of each kind, on a screen of 100 by 40: small whole numbers, and numbers of about one.
    let reports = folder("reports")?;
    let sizes =
        [size_of::<Health>(), size_of::<ControllerHealth>(), size_of::<Drift>(), size_of::<Timing>(), size_of::<Set>()];
    let (mut small, mut ones) = (vec![100, 40, 3], vec![100, 40, 3]);
    for (kind, size) in (0_u8..).zip(sizes.into_iter().chain([size_of::<Set>()])) {
        small.push(kind);
        small.extend((0..size).map(|k| u8::from(k % 4 == 0) * (k / 4 % 5) as u8));
        ones.push(kind);
        ones.extend(1.0_f64.to_le_bytes().into_iter().cycle().take(size));
    }
    fs::write(reports.join("small"), small)?;
    fs::write(reports.join("ones"), ones)?;
    // Text: their seeds are the robots and the bad files of the configuration's tests; here what those lack.
    fs::write(folder("config")?.join("empty.toml"), "")?;
    // Everything that a robot file may have beside: what was identified, and every effect.
    let arm = rivet_config::load(corpus.join("../../../robots/dd2/robot.toml"))?;
    let path = folder("config")?.join("identified.toml");
    rivet_config::write_identified(&arm, &arm.nominal_base, &vec![0.1; arm.nominal_base.len()], &path)?;
    // The target reads it as if it lay beside the arm's own file.
    let text = fs::read_to_string(&path)?.replace("../../../../robots/dd2/", "");
    fs::write(&path, text)?;
    fs::write(folder("urdf")?.join("empty.urdf"), "<robot name=\"a\"/>")?;
    let t: Vec<f64> = (0..50).map(|k| 0.01 * f64::from(k)).collect();
    let columns: Vec<(&str, &[f64])> = ["t", "q1", "q2", "tau1", "tau2"].map(|name| (name, &t[..])).to_vec();
    rivet_logs::write_columns(&folder("log-parquet")?.join("sound.parquet"), &columns)?;
    let mut text = String::from("t,q1,q2,tau1,tau2\n");
    for t in &t {
        writeln!(text, "{t},{t},{t},{t},{t}")?;
    }
    fs::write(folder("log-csv")?.join("sound.csv"), text)?;
    fs::write(folder("log-csv")?.join("current.csv"), "t,q1,q2,current1,current2\n0,1,2,3,4\n0.01,1,2,3,4\n")?;
    // Places of a memory and what is put there.
    let mut places = Vec::new();
    for (place, number) in [(0_u32, 1.0_f64), (100, -1e300), (500, 1e9), (777, 0.0)] {
        places.extend(place.to_le_bytes());
        places.extend(number.to_le_bytes());
    }
    fs::write(folder("memory")?.join("few.bin"), places)?;
    let n = 8;
    let supervised = || Some(Supervision { state: vec![1; n], excitation: vec![0.5; n] });
    let memory = Memory { fingerprint: 7, numbers: vec![0.25; 40] };
    for (name, supervision, memory) in
        [("plain", None, None), ("supervised", supervised(), None), ("whole", supervised(), Some(memory))]
    {
        let temporary = tempfile::tempdir()?;
        let parameters = Parameters { epoch: 3, seq: 300, values: vec![1.5; n], std: vec![0.1; n] };
        let knowledge = Knowledge { model_hash: STORED.1, parameters, supervision, memory };
        Store::open(temporary.path(), STORED.0)?.save(&knowledge)?;
        for target in ["store", "store-resealed"] {
            fs::copy(temporary.path().join("arm.1.state"), folder(target)?.join(format!("{name}.state")))?;
        }
    }
    Ok(())
}
