//! Programs of different versions that meet are told which of them to update.

use iceoryx2::prelude::{NodeBuilder, ServiceName, SignalHandlingMode, ZeroCopySend, ipc};
use rivet_ipc_schema::{Bus, BusError, ControlReply, ControlRequest, PrivateBus, RobotName, Verdict};

/// Messages of a program that is newer, older, careless or a stranger.
macro_rules! foreign {
    ($name:ident, $type_name:literal, $words:literal) => {
        #[derive(Clone, Copy, Debug, ZeroCopySend)]
        #[type_name($type_name)]
        #[repr(C)]
        struct $name {
            words: [u64; $words],
        }
        impl Default for $name {
            fn default() -> Self {
                Self { words: [0; $words] }
            }
        }
    };
}
foreign!(Newer, "rivet.JointState.v2", 31);
foreign!(NewerOfEqualSize, "rivet.JointState.v3", 27);
foreign!(Older, "rivet.JointState.v0", 20);
foreign!(Careless, "rivet.JointState.v1", 28);
foreign!(Stranger, "acme.State", 27);
foreign!(NewerCommand, "rivet.Command.v2", 12);
foreign!(OlderCommand, "rivet.Command.v0", 10);
foreign!(NewerReply, "rivet.ControlReply.v3", 3);
foreign!(OlderRequest, "rivet.ControlRequest.v0", 1);

fn robot() -> RobotName {
    RobotName::new("x").expect("a good name")
}

fn foreign_node(private: &PrivateBus) -> iceoryx2::node::Node<ipc::Service> {
    NodeBuilder::new()
        .config(&private.config().iceoryx().expect("config"))
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .expect("node")
}

fn name(service: &str) -> ServiceName {
    ServiceName::new(&format!("rivet/x/{service}")).expect("name")
}

/// The refusals that our publisher and our subscriber get where `T` is on the service.
fn refusals<T: core::fmt::Debug + ZeroCopySend>() -> [BusError; 2] {
    let private = PrivateBus::new("version");
    let node = foreign_node(&private);
    let _service =
        node.service_builder(&name("joint-state")).publish_subscribe::<T>().open_or_create().expect("foreign");
    let bus = Bus::open(private.config(), &robot(), "ours").expect("bus");
    [bus.joint_state_publisher().unwrap_err(), bus.joint_state_subscriber().unwrap_err()]
}

fn assert_verdict<T: core::fmt::Debug + ZeroCopySend>(verdict: Verdict, text: &str) {
    for refusal in refusals::<T>() {
        assert!(matches!(&refusal, BusError::Version(mismatch) if mismatch.verdict == verdict), "{refusal:?}");
        assert_eq!(refusal.to_string(), text);
    }
}

#[test]
fn a_newer_service_refuses_us_as_the_older_side() {
    assert_verdict::<Newer>(
        Verdict::ThisIsOlder,
        "service rivet/x/joint-state carries rivet.JointState.v2 but this program speaks v1: \
         this program is the older side; update it",
    );
    // Equal size and alignment: only the name can tell.
    for refusal in refusals::<NewerOfEqualSize>() {
        assert!(refusal.to_string().contains("carries rivet.JointState.v3"), "{refusal}");
    }
}

#[test]
fn an_older_service_is_named_as_the_older_side() {
    assert_verdict::<Older>(
        Verdict::OtherIsOlder,
        "service rivet/x/joint-state carries rivet.JointState.v0 but this program speaks v1: \
         the program that created the service is the older side; update and restart it",
    );
}

#[test]
fn a_layout_changed_under_the_old_name_and_a_stranger_are_told_apart() {
    for refusal in refusals::<Careless>() {
        assert!(
            matches!(&refusal, BusError::Version(m) if m.verdict == Verdict::SameVersionOtherLayout),
            "{refusal:?}"
        );
    }
    for refusal in refusals::<Stranger>() {
        assert!(matches!(&refusal, BusError::Version(m) if m.verdict == Verdict::OtherMessage), "{refusal:?}");
        assert!(refusal.to_string().contains("carries acme.State"), "{refusal}");
    }
}

/// A foreign blackboard that says what it carries, as ours do.
macro_rules! blackboard {
    ($node:expr, $type:ty, $type_name:literal) => {
        $node
            .service_builder(&name("command"))
            .blackboard_creator::<u64>()
            .add::<$type>(0, <$type>::default())
            .create_with_attributes(
                &iceoryx2::service::attribute::AttributeSpecifier::new()
                    .define(&"rivet.type".try_into().unwrap(), &$type_name.try_into().unwrap())
                    .unwrap(),
            )
            .expect("foreign blackboard")
    };
}

#[test]
fn a_blackboard_of_another_version_is_refused_by_readers() {
    let private = PrivateBus::new("boards");
    let node = foreign_node(&private);
    let bus = Bus::open(private.config(), &robot(), "ours").expect("bus");
    {
        let _board = blackboard!(node, NewerCommand, "rivet.Command.v2");
        let refusal = bus.command_reader().unwrap_err();
        assert!(matches!(&refusal, BusError::Version(m) if m.verdict == Verdict::ThisIsOlder), "{refusal:?}");
        assert!(refusal.to_string().contains("carries rivet.Command.v2"), "{refusal}");
    }
    let _board = blackboard!(node, OlderCommand, "rivet.Command.v0");
    let refusal = bus.command_reader().unwrap_err();
    assert!(matches!(&refusal, BusError::Version(m) if m.verdict == Verdict::OtherIsOlder), "{refusal:?}");
}

/// After an update of the writer, a reader of the old version may still sit on the old blackboard.
#[test]
fn an_updated_writer_replaces_the_blackboard_that_old_readers_keep() {
    let private = PrivateBus::new("update");
    let node = foreign_node(&private);
    let _kept_by_an_old_reader = blackboard!(node, OlderCommand, "rivet.Command.v0");
    let bus = Bus::open(private.config(), &robot(), "ours").expect("bus");
    let writer = bus.command_writer().expect("the lock is free: the old writer is gone");
    writer.write(&rivet_ipc_schema::Command { seq: 5, stamp_ns: 5, ..Default::default() });
    assert_eq!(bus.command_reader().expect("reader").latest().map(|command| command.seq), Some(5));
}

#[test]
fn control_of_another_version_is_refused() {
    let private = PrivateBus::new("control");
    let node = foreign_node(&private);
    let bus = Bus::open(private.config(), &robot(), "ours").expect("bus");
    {
        let service = node.service_builder(&name("control")).request_response::<ControlRequest, NewerReply>();
        let _service = service.open_or_create().expect("foreign");
        let refusal = bus.control_client().unwrap_err().to_string();
        assert!(
            refusal.contains("carries rivet.ControlReply.v3") && refusal.contains("this program is the older"),
            "{refusal}"
        );
    }
    let service = node.service_builder(&name("control")).request_response::<OlderRequest, ControlReply>();
    let _service = service.open_or_create().expect("foreign");
    let refusal = bus.control_server().unwrap_err().to_string();
    assert!(
        refusal.contains("carries rivet.ControlRequest.v0") && refusal.contains("created the service is the older"),
        "{refusal}"
    );
}

/// A robot controller of somebody's own that creates its services first, with the bus library's default settings.
#[test]
fn services_with_other_settings_are_named_with_both_settings_and_the_mend() {
    let private = PrivateBus::new("settings");
    let node = foreign_node(&private);
    let _states = node
        .service_builder(&name("joint-state"))
        .publish_subscribe::<rivet_ipc_schema::JointState>()
        .create()
        .expect("foreign");
    let _event = node.service_builder(&name("joint-state")).event().max_nodes(20).create().expect("foreign");
    let bus = Bus::open(private.config(), &robot(), "ours").expect("bus");
    let refusal = bus.joint_state_subscriber().unwrap_err();
    let BusError::Settings { service, found, needed } = &refusal else { panic!("{refusal:?}") };
    assert_eq!(service, "rivet/x/joint-state");
    assert!(found.contains("subscriber buffer 2,") && found.contains("subscribers 8,"), "{found}");
    assert!(needed.contains("subscriber buffer 1024,") && needed.contains("subscribers 16,"), "{needed}");
    assert!(refusal.to_string().contains("start rivetd, then that program"), "{refusal}");
    let refusal = bus.joint_state_notifier().unwrap_err().to_string();
    assert!(refusal.contains("joint-state (event)") && refusal.contains("nodes 20, and rivet needs"), "{refusal}");
}
