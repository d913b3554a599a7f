//! What the C interface refuses, with which status and text.
#![allow(unsafe_code, reason = "calls the C interface")]

use iceoryx2::prelude::{NodeBuilder, ServiceName, SignalHandlingMode, ZeroCopySend, ipc};
use rivet::abi::{
    RIVET_ABI, RivetRobot, rivet_close, rivet_error, rivet_open, rivet_publish, rivet_read_command,
    rivet_read_counters, rivet_read_parameters, rivet_status_text, rivet_version, rivet_wait_command,
};
use rivet::{Sample, Status};
use rivet_ipc_schema::{BusConfig, PrivateBus};
use std::ffi::{CStr, CString, c_char};
use std::os::unix::ffi::OsStrExt as _;
use std::ptr::{null, null_mut};

fn text(pointer: *const c_char) -> String {
    assert!(!pointer.is_null());
    // SAFETY: the library's texts end with a zero byte and are valid until its next call.
    unsafe { CStr::from_ptr(pointer) }.to_string_lossy().into_owned()
}

fn open(abi: u32, name: &str, config: &BusConfig, joints: u32) -> Result<*mut RivetRobot, (Status, String)> {
    let (name, prefix) = (CString::new(name).expect("text"), CString::new(config.prefix.as_str()).expect("text"));
    let root = CString::new(config.root.as_os_str().as_bytes()).expect("text");
    let mut robot = null_mut();
    // SAFETY: strings that end with a zero byte, and a place for a pointer.
    let status = unsafe { rivet_open(abi, name.as_ptr(), prefix.as_ptr(), root.as_ptr(), joints, &raw mut robot) };
    // SAFETY: NULL is allowed.
    if status == Status::Ok { Ok(robot) } else { Err((status, text(unsafe { rivet_error(null_mut()) }))) }
}

#[test]
fn values_that_break_a_rule_are_named() {
    let private = PrivateBus::new("rules");
    let config = private.config();
    for (name, joints, part) in
        [("Arm 1", 6, "robot name \"Arm 1\""), ("arm", 9, "joints: 9; it must be the robot file's, 1 to 8")]
    {
        let (status, why) = open(RIVET_ABI, name, config, joints).expect_err("refused");
        assert!(status == Status::Argument && why.contains(part), "{status:?}: {why}");
    }
    let bad = BusConfig { prefix: "a/b".to_owned(), ..config.clone() };
    let (status, why) = open(RIVET_ABI, "arm", &bad, 6).expect_err("refused");
    assert!(status == Status::Argument && why.contains("bus prefix \"a/b\""), "{status:?}: {why}");
}

#[test]
fn a_program_of_another_interface_is_named_with_both_versions() {
    let private = PrivateBus::new("abi");
    for (abi, side) in
        [(RIVET_ABI - 1, "the program is the older side"), (RIVET_ABI + 1, "the library is the older side")]
    {
        let (status, why) = open(abi, "arm", private.config(), 6).expect_err("refused");
        assert_eq!(status, Status::Version);
        let both = [format!("interface {abi}"), format!("librivet has {RIVET_ABI}")];
        assert!(both.iter().all(|part| why.contains(part)) && why.contains(side), "{why}");
    }
    assert!(text(rivet_version()).ends_with(&format!("interface {RIVET_ABI}")));
    let soname = format!("librivet.so.{RIVET_ABI}\"");
    assert!(include_str!("../build.rs").contains(&soname), "the soname has the interface's number");
}

/// A daemon of a later version.
#[derive(Clone, Copy, Debug, ZeroCopySend)]
#[type_name("rivet.Parameters.v99")]
#[repr(C)]
struct Later {
    words: [u64; 600],
}

#[test]
fn a_daemon_of_another_version_is_named_with_both_versions() {
    let private = PrivateBus::new("later");
    let config = private.config().iceoryx().expect("sound");
    let node = NodeBuilder::new().config(&config).signal_handling_mode(SignalHandlingMode::Disabled);
    let node = node.create::<ipc::Service>().expect("a node");
    let name = ServiceName::new("rivet/arm/parameters").expect("a name");
    let _service = node.service_builder(&name).publish_subscribe::<Later>().create().expect("a service");
    let (status, why) = open(RIVET_ABI, "arm", private.config(), 6).expect_err("refused");
    assert_eq!(status, Status::Version);
    assert!(why.contains("carries rivet.Parameters.v99") && why.contains("this program is the older side"), "{why}");
}

/// A robot program that created its services by itself, with default settings.
#[test]
fn a_service_with_other_settings_is_named_with_both_settings() {
    let private = PrivateBus::new("others");
    let config = private.config().iceoryx().expect("sound");
    let node = NodeBuilder::new().config(&config).signal_handling_mode(SignalHandlingMode::Disabled);
    let node = node.create::<ipc::Service>().expect("a node");
    let name = ServiceName::new("rivet/arm/joint-state").expect("a name");
    let service = node.service_builder(&name).publish_subscribe::<rivet_ipc_schema::JointState>();
    let _service = service.create().expect("a service");
    let (status, why) = open(RIVET_ABI, "arm", private.config(), 6).expect_err("refused");
    assert_eq!(status, Status::Bus);
    assert!(why.contains("subscriber buffer 2,") && why.contains("subscriber buffer 1024,"), "{why}");
    assert!(why.contains("start rivetd, then that program"), "{why}");
}

#[test]
fn null_is_refused_and_a_reader_publishes_nothing() {
    let private = PrivateBus::new("null");
    let sample = Sample::default();
    // SAFETY: NULL is allowed everywhere; otherwise an open robot and values of the right types.
    unsafe {
        let mut robot = null_mut();
        assert_eq!(rivet_open(RIVET_ABI, null(), null(), null(), 6, &raw mut robot), Status::Argument);
        assert_eq!(rivet_publish(null_mut(), &raw const sample), Status::Argument);
        assert_eq!(rivet_read_parameters(null_mut(), null_mut()), Status::Argument);
        rivet_close(null_mut());
        let robot = open(RIVET_ABI, "arm", private.config(), 0).expect("a reader");
        assert_eq!(rivet_publish(robot, null()), Status::Argument);
        assert_eq!(rivet_publish(robot, &raw const sample), Status::Argument);
        assert_eq!(rivet_wait_command(robot, 1, null_mut()), Status::Argument);
        assert_eq!(rivet_read_command(robot, 1, null_mut()), Status::Argument);
        assert_eq!(rivet_read_counters(robot, null_mut()), Status::Argument);
        let mut parameters = rivet_ipc_schema::Parameters { epoch: 7, ..Default::default() };
        assert_eq!(rivet_read_parameters(robot, &raw mut parameters), Status::None);
        assert_eq!(parameters.epoch, 7, "unchanged");
        assert_eq!(text(rivet_error(robot)), "");
        rivet_close(robot);
    }
}

#[test]
fn every_status_has_a_text() {
    for number in -6..=2 {
        assert!(Status::from_number(number).is_some());
        assert_ne!(text(rivet_status_text(number)), text(rivet_status_text(99)), "{number}");
    }
}
