//! Files that independent libraries of Python write: `mcap`, `mcap-ros2-support`, `rosbags`, `polars`. Where Python lacks one, its test is
//! skipped, visibly. `RIVET_PYTHON` names another interpreter.

use std::io::Write as _;
use std::path::Path;
use std::process::Command;

use rivet_logs::{ChannelMap, Log, Naming, ReadOptions, read_as, write_columns};

use crate::formats::{alphabetical, assert_same, joints, measured};

/// Runs a script with the path of the measured set as Parquet and a folder; none where a module is missing.
fn written_by(modules: &[&str], script: &str) -> Option<(tempfile::TempDir, Log)> {
    let measured = measured()?;
    let python = std::env::var_os("RIVET_PYTHON").unwrap_or_else(|| "python3".into());
    let imports = format!("import {}", modules.join(", "));
    let found = Command::new(&python).args(["-c", &imports]).output();
    if !found.is_ok_and(|output| output.status.success()) {
        let _ = writeln!(std::io::stderr(), "SKIPPED: Python has not all of {}", modules.join(", "));
        return None;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let source = folder.path().join("measured.bin");
    // Time in ns, positions and torques in alphabetical order, as little-endian numbers.
    let mut bytes = Vec::new();
    for k in 0..measured.len() {
        bytes.extend(((measured.t[k] * 1e9).round() as i64 + 1_700_000_000_000_000_000).to_le_bytes());
        for signals in [&measured.q, measured.torque().expect("torque")] {
            for j in alphabetical() {
                bytes.extend(signals[j][k].to_le_bytes());
            }
        }
    }
    std::fs::write(&source, bytes).expect("written");
    let names: Vec<String> = alphabetical().iter().map(|j| joints()[*j].clone()).collect();
    let head = "import sys, struct\nfolder, names = sys.argv[1], sys.argv[2].split(',')\n\
                raw = open(folder + '/measured.bin', 'rb').read()\n\
                rows = [(r[0], list(r[1:8]), list(r[8:15])) for r in struct.iter_unpack('<q14d', raw)]\n";
    let output = Command::new(&python)
        .args(["-c", &format!("{head}{script}")])
        .arg(folder.path())
        .arg(names.join(","))
        .output()
        .expect("python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some((folder, measured))
}

fn check(what: &str, path: &Path, measured: &Log) {
    let naming = Naming { joints: &joints(), map: &ChannelMap::default() };
    let log = read_as(path, &ReadOptions::new(7), &naming).unwrap_or_else(|why| panic!("{what}: {why}"));
    assert_same(what, &log, measured);
}

#[test]
fn arrays_of_numpy_are_read() {
    let order = format!("order = [names.index(name) for name in {:?}]", joints());
    let script = r"
import numpy as np
t = np.array([r[0] for r in rows], dtype=np.int64)
q, tau = np.array([r[1] for r in rows]), np.array([r[2] for r in rows])
q, tau = q[:, order], tau[:, order]
np.savez(folder + '/plain.npz', time_ns=t, q=q, tau=tau, names=np.array(names), one=np.array(3.0), step=np.arange(5))
np.savez_compressed(folder + '/turned.npz', time_ns=t, q=q.T, tau=np.asfortranarray(tau))
np.savez(folder + '/big.npz', time_ns=t.astype('>i8'), q=q.astype('>f8'), tau=tau, extra=np.array([{'a': 1}], dtype=object))
";
    let Some((folder, measured)) = written_by(&["numpy"], &format!("{order}{script}")) else { return };
    for name in ["plain", "turned", "big"] {
        check(name, &folder.path().join(name).with_extension("npz"), &measured);
    }
}

#[test]
fn data_sets_of_h5py_are_read() {
    let order = format!("order = [names.index(name) for name in {:?}]", joints());
    let script = r"
import h5py, numpy as np
t = np.array([r[0] for r in rows], dtype=np.int64)
q, tau = np.array([r[1] for r in rows]), np.array([r[2] for r in rows])
q, tau = q[:, order], tau[:, order]
packings = [dict(), dict(compression='gzip', shuffle=True), dict(compression='lzf'), dict(fletcher32=True, maxshape=(None, None))]
for lib in ['earliest', 'latest']:
    for k, packing in enumerate(packings):
        with h5py.File(f'{folder}/{lib}{k}.h5', 'w', libver=lib) as f:
            f['observations/time_ns'] = t
            f.create_dataset('observations/q', data=q.astype('>f8'), chunks=(100, 3) if packing else None, **packing)
            f.create_dataset('observations/tau', data=tau, chunks=(64, 7) if packing else None, **packing)
            f.create_dataset('images/wrist', data=np.zeros((4, 8, 8, 3), 'u1'), compression='gzip')
            f['names'] = np.array(names, dtype=h5py.string_dtype())
            f['scalar'], f['soft'] = 3.0, h5py.SoftLink('/observations/q')
            f['outside'] = h5py.ExternalLink('elsewhere.h5', '/q')
table = np.zeros(len(t), np.dtype([('time_ns', 'i8'), ('q', 'f8', (7,)), ('flag', '?'), ('tau', '>f8', (7,))]))
table['time_ns'], table['q'], table['tau'] = t, q, tau
with h5py.File(folder + '/structure.h5', 'w') as f:
    f['log'] = table
with h5py.File(folder + '/turned.h5', 'w', userblock_size=512) as f:
    f['time_ns'], f['q'], f['tau'] = t.reshape(1, -1), q.T, tau.T
with open(folder + '/turned.h5', 'r+b') as f:
    f.write(b'MATLAB 7.3 MAT-file')
";
    let Some((folder, measured)) = written_by(&["numpy", "h5py"], &format!("{order}{script}")) else { return };
    let packed = ["earliest", "latest"].into_iter().flat_map(|lib| (0..4).map(move |k| format!("{lib}{k}")));
    for name in packed.chain(["structure".to_owned(), "turned".to_owned()]) {
        check(&name, &folder.path().join(&name).with_extension("h5"), &measured);
    }
}

/// What rivet writes, read by other programs: their numbers are the measured ones, to the bit.
#[test]
fn other_programs_read_what_rivet_writes() {
    let script = r#"
import numpy as np
with open(folder + '/read.py', 'w') as out:
    out.write("""
import sys, numpy as np
folder = sys.argv[1]
arrays = np.load(folder + '/run.npz')
assert str(arrays['conventions']).endswith('zeros of the model'), arrays['conventions']
from mcap_ros2.reader import read_ros2_messages
messages = [m.ros_msg for m in read_ros2_messages(folder + '/run.mcap') if m.channel.topic == '/joint_states']
q = np.array([list(m.position) for m in messages])
tau = np.array([list(m.effort) for m in messages])
assert np.array_equal(q, arrays['q']) and np.array_equal(tau, arrays['tau']) and len(q) == len(arrays['t'])
t = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages])
assert np.allclose(t - t[0], arrays['t'] - arrays['t'][0], rtol=0, atol=1e-8)
assert list(messages[0].name) == sys.argv[2].split(','), messages[0].name
import importlib.util
if importlib.util.find_spec('h5py'):
    import h5py
    with h5py.File(folder + '/run.h5') as f:
        assert f.attrs['conventions'].decode().endswith('zeros of the model'), f.attrs['conventions']
        assert np.array_equal(f['q'], q) and np.array_equal(f['tau'], tau) and np.array_equal(f['t'], arrays['t'])
import csv
lines = [line for line in open(folder + '/run.csv') if not line.startswith('#')]
table = list(csv.reader(lines))
assert [float(x) for x in table[5]][1:8] == list(arrays['q'][4]), table[0]
print(len(q))
""")
"#;
    let Some((folder, measured)) = written_by(&["numpy", "mcap", "mcap_ros2"], script) else { return };
    for ending in ["npz", "h5", "mcap", "csv"] {
        rivet_logs::write_log(&folder.path().join("run").with_extension(ending), &measured, &joints())
            .expect("written");
    }
    let python = std::env::var_os("RIVET_PYTHON").unwrap_or_else(|| "python3".into());
    let output = Command::new(python)
        .arg(folder.path().join("read.py"))
        .arg(folder.path())
        .arg(joints().join(","))
        .output()
        .expect("python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), measured.len().to_string());
}

#[test]
fn mcap_of_python_is_read() {
    let script = r#"
from mcap_ros2.writer import Writer
from mcap.writer import CompressionType
text = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
for name, compression in [('lz4', CompressionType.LZ4), ('zstd', CompressionType.ZSTD), ('none', CompressionType.NONE)]:
    with open(folder + '/' + name + '.mcap', 'wb') as stream:
        writer = Writer(stream, compression=compression)
        schema = writer.register_msgdef('sensor_msgs/msg/JointState', text)
        for t, q, tau in rows:
            message = {'header': {'stamp': {'sec': t // 10**9, 'nanosec': t % 10**9}, 'frame_id': ''}, 'name': names, 'position': q, 'velocity': [], 'effort': tau}
            writer.write_message('/joint_states', schema, message, log_time=t + 1000, publish_time=t)
        writer.finish()
"#;
    let Some((folder, measured)) = written_by(&["mcap", "mcap_ros2", "lz4", "zstandard"], script) else { return };
    for name in ["lz4", "zstd", "none"] {
        check(name, &folder.path().join(format!("{name}.mcap")), &measured);
    }
}

#[test]
fn bags_of_rosbags_are_read() {
    let script = r"
from rosbags.rosbag2 import Writer, StoragePlugin
from rosbags.typesys import Stores, get_typestore
import numpy as np
store = get_typestore(Stores.ROS2_HUMBLE)
State, Header, Time = (store.types[n] for n in ('sensor_msgs/msg/JointState', 'std_msgs/msg/Header', 'builtin_interfaces/msg/Time'))
for name, plugin in [('mcap', StoragePlugin.MCAP), ('sqlite', StoragePlugin.SQLITE3)]:
    with Writer(folder + '/' + name, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection('/joint_states', State.__msgtype__, typestore=store)
        for t, q, tau in rows:
            message = State(header=Header(stamp=Time(sec=t // 10**9, nanosec=t % 10**9), frame_id='base'), name=names, position=np.array(q), velocity=np.array([]), effort=np.array(tau))
            writer.write(connection, t, store.serialize_cdr(message, State.__msgtype__))
";
    let Some((folder, measured)) = written_by(&["rosbags.rosbag2", "numpy"], script) else { return };
    check("rosbag2, MCAP", &folder.path().join("mcap"), &measured);
    if cfg!(feature = "sqlite") {
        check("rosbag2, sqlite3", &folder.path().join("sqlite"), &measured);
    }
}

#[test]
fn tables_of_polars_are_read() {
    let script = r"
import polars as pl
flat = {'t': [(t - rows[0][0]) / 1e9 for t, _, _ in rows]}
for k, name in enumerate(names):
    flat[name + '/position'] = [q[k] for _, q, _ in rows]
    flat[name + '/effort'] = [tau[k] for _, _, tau in rows]
table = pl.DataFrame(flat)
for codec in ['lz4', 'snappy', 'gzip', 'brotli', 'zstd', 'uncompressed']:
    table.write_parquet(folder + '/' + codec + '.parquet', compression=codec)
table.write_csv(folder + '/flat.csv', separator=';')
order = [names.index(n) for n in sys.argv[3:]] if len(sys.argv) > 3 else None
stamped = pl.DataFrame({'timestamp': [t for t, _, _ in rows]}).with_columns(pl.col('timestamp').cast(pl.Datetime('ns')))
pl.concat([stamped, table.drop('t')], how='horizontal').write_parquet(folder + '/stamped.parquet')
";
    let Some((folder, measured)) = written_by(&["polars"], script) else { return };
    for codec in ["lz4", "snappy", "gzip", "brotli", "zstd", "uncompressed", "stamped"] {
        check(codec, &folder.path().join(format!("{codec}.parquet")), &measured);
    }
    check("csv", &folder.path().join("flat.csv"), &measured);
    // What rivet writes itself is the same set.
    let own = folder.path().join("own.parquet");
    let tau = measured.torque().expect("torque");
    let columns: Vec<(String, &[f64])> = std::iter::once(("t".to_owned(), measured.t.as_slice()))
        .chain(measured.q.iter().enumerate().map(|(j, q)| (format!("q{}", j + 1), q.as_slice())))
        .chain(tau.iter().enumerate().map(|(j, tau)| (format!("tau{}", j + 1), tau.as_slice())))
        .collect();
    write_columns(&own, &columns).expect("written");
    check("own", &own, &measured);
}
