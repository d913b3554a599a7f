//! What the crate promises to a real-time thread: receiving and the blackboard never allocate.

use allocation_counter::{AllocationInfo, measure};
use rivet_ipc_schema::{Bus, Command, Health, JointState, Parameters, PrivateBus, RobotName, Setpoint};

#[test]
fn receiving_and_the_blackboard_do_not_allocate() {
    let private = PrivateBus::new("alloc");
    let bus = Bus::open(private.config(), &RobotName::new("arm").unwrap(), "test").unwrap();
    let (states, state_publisher) = (bus.joint_state_subscriber().unwrap(), bus.joint_state_publisher().unwrap());
    let (setpoints, setpoint_publisher) = (bus.setpoint_subscriber().unwrap(), bus.setpoint_publisher().unwrap());
    let (parameters, parameter_publisher) = (bus.parameters_subscriber().unwrap(), bus.parameters_publisher().unwrap());
    let (healths, health_publisher) = (bus.health_subscriber().unwrap(), bus.health_publisher().unwrap());
    let (writer, reader) = (bus.command_writer().unwrap(), bus.command_reader().unwrap());
    let (latest_writer, latest) = (bus.latest_parameters_writer().unwrap(), bus.latest_parameters_reader().unwrap());
    let mut seen = 0_u64;
    for round in 0..300_u64 {
        state_publisher.send(&JointState { seq: round, ..JointState::default() }).unwrap();
        setpoint_publisher.send(&Setpoint { seq: round, ..Setpoint::default() }).unwrap();
        parameter_publisher.send(&Parameters { epoch: round, ..Parameters::default() }).unwrap();
        health_publisher.send(&Health { seq: round, ..Health::default() }).unwrap();
        let heap = measure(|| {
            seen += u64::from(states.receive().unwrap().is_some());
            seen += u64::from(setpoints.receive().unwrap().is_some());
            seen += u64::from(parameters.receive_with(|message| message.epoch == round).unwrap() == Some(true));
            seen += u64::from(healths.receive_newest().unwrap().is_some());
            assert!(states.receive().unwrap().is_none());
            writer.write(&Command { seq: round, stamp_ns: round + 1, ..Command::default() });
            seen += u64::from(reader.latest().is_some_and(|command| command.seq == round));
            latest_writer.write(&Parameters { epoch: round, stamp_ns: round + 1, ..Parameters::default() });
            seen += u64::from(latest.latest().is_some_and(|parameters| parameters.epoch == round));
        });
        // The first round meets the publishers, which maps their memory.
        assert!(heap == AllocationInfo::default() || round == 0, "round {round}: {heap:?}");
    }
    assert_eq!(seen, 300 * 6);
}
