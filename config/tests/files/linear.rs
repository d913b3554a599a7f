//! A robot file with four times the mistakes, and a URDF with four times the links, take four times the work; the deepest take a small stack.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use rivet_config::load;

/// The smaller input is this part of the larger one.
const PART: usize = 4;
/// Work of the larger input over that of the smaller: 4 where it is linear, 16 where it is quadratic; this is their geometric mean.
const MAX_RATIO: f64 = 8.0;
/// The least of so many runs is what other programs disturbed least.
const RUNS: usize = 7;

/// Processor time of this thread \[s\]: what else the machine does is not in it. The scheduler's statistics lag by up to a tick; this clock
/// does not.
fn thread_s() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

fn work(run: impl FnOnce()) -> f64 {
    let begin = thread_s();
    run();
    thread_s() - begin
}

fn assert_linear(what: &str, count: usize, input: impl Fn(usize) -> (String, String), expect: impl Fn(&Path) -> bool) {
    let folders = [count / PART, count].map(|n| {
        let folder = tempfile::tempdir().expect("a folder");
        let (toml, urdf) = input(n);
        fs::write(folder.path().join("robot.toml"), toml).expect("written");
        fs::write(folder.path().join("robot.urdf"), urdf).expect("written");
        folder
    });
    // In turn, so that a slow minute of the machine meets both.
    let mut least_s = [f64::INFINITY; 2];
    for _ in 0..RUNS {
        for (least_s, folder) in least_s.iter_mut().zip(&folders) {
            let robot = folder.path().join("robot.toml");
            *least_s = least_s.min(work(|| assert!(expect(&robot), "{what}")));
        }
    }
    let [part_s, all_s] = least_s;
    assert!(all_s < MAX_RATIO * part_s, "{what}: {part_s} s for {}, {all_s} s for {count}", count / PART);
}

/// A sound arm: the text of its robot file and of its URDF.
fn sound() -> (String, String) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/dd2");
    let read = |name: &str| fs::read_to_string(folder.join(name)).expect("a file of the project");
    (read("robot.toml"), read("robot.urdf"))
}

#[test]
fn unknown_keys_take_linear_work() {
    let input = |n: usize| {
        let (toml, urdf) = sound();
        let keys: String = (0..n).fold(String::new(), |mut text, k| {
            let _ = writeln!(text, "key{k} = 1");
            text
        });
        (keys + &toml, urdf)
    };
    let refused = |robot: &Path| load(robot).is_err_and(|why| why.to_string().contains("key0"));
    assert_linear("unknown keys", 15_000, input, refused);
}

#[test]
fn syntax_errors_take_linear_work() {
    let input = |n: usize| ("= \n".repeat(n), sound().1);
    assert_linear("syntax errors", 20_000, input, |robot| load(robot).is_err());
}

#[test]
fn fixed_links_take_linear_work() {
    let input = |n: usize| {
        let (toml, urdf) = sound();
        let mut links = String::new();
        for k in 0..n {
            let above = if k == 0 { "link_2".to_owned() } else { format!("f{}", k - 1) };
            let _ = write!(links, "<link name=\"f{k}\"/><joint name=\"m{k}\" type=\"fixed\">");
            let _ = write!(links, "<parent link=\"{above}\"/><child link=\"f{k}\"/></joint>");
        }
        (toml, urdf.replace("</robot>", &format!("{links}</robot>")))
    };
    // Four elements a link, of at most 50 000.
    assert_linear("fixed links", 12_000, input, |robot| load(robot).is_ok());
}

/// Stack of the thread that reads \[bytes\]; threads of the daemon have 2 MiB.
const SMALL_STACK_BYTES: usize = 256 << 10;

#[test]
fn deepest_accepted_file_is_read_on_a_small_stack() {
    let folder = tempfile::tempdir().expect("a folder");
    let robot = folder.path().join("robot.toml");
    let (toml, urdf) = sound();
    fs::write(folder.path().join("robot.urdf"), urdf).expect("written");
    let nested =
        |open: &str, close: &str, depth: usize| format!("k = {}1{}\n{toml}", open.repeat(depth), close.repeat(depth));
    // 32 brackets and 16 dots are the limits (config/src/toml_limits.rs).
    let dotted = |dots: usize| format!("{}k = 1\n{toml}", "k.".repeat(dots));
    let cases = [
        (nested("[", "]", 32), "unknown"),
        (nested("{ k = ", " }", 32), "unknown"),
        (dotted(16), "unknown"),
        (nested("[", "]", 33), "nested more than 32 deep"),
        (nested("{ k = ", " }", 33), "nested more than 32 deep"),
        (dotted(17), "more than 16 dots"),
    ];
    for (text, why) in cases {
        fs::write(&robot, text).expect("written");
        let path = robot.clone();
        let small = std::thread::Builder::new().stack_size(SMALL_STACK_BYTES).spawn(move || load(&path));
        let said = small.expect("a thread").join().expect("it ends").expect_err("no key of a robot file").to_string();
        assert!(said.contains(why), "{why}: {said}");
    }
}
