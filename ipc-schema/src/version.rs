//! Which side is older when two programs disagree about a message.

use iceoryx2::prelude::{Config, MessagingPattern, ServiceName, ipc};
use iceoryx2::service::Service as _;

use crate::error::{Verdict, VersionMismatch};
use crate::messages::Message;

/// Splits `rivet.JointState.v12` into `JointState` and 12.
fn parse(type_name: &str) -> Option<(&str, u32)> {
    let (name, version) = type_name.strip_prefix("rivet.")?.rsplit_once(".v")?;
    Some((name, version.parse().ok()?))
}

/// Compares the type a service carries with the message this program speaks.
fn verdict<T: Message>(carried: &str) -> Verdict {
    match parse(carried) {
        Some((name, version)) if name == T::NAME => match version.cmp(&T::VERSION) {
            core::cmp::Ordering::Greater => Verdict::ThisIsOlder,
            core::cmp::Ordering::Less => Verdict::OtherIsOlder,
            core::cmp::Ordering::Equal => Verdict::SameVersionOtherLayout,
        },
        _ => Verdict::OtherMessage,
    }
}

/// The report that `service` carries `carried` where `T` was expected.
pub(crate) fn mismatch<T: Message>(service: &str, carried: &str) -> VersionMismatch {
    VersionMismatch {
        service: service.to_owned(),
        carried: carried.to_owned(),
        spoken: T::TYPE_NAME,
        verdict: verdict::<T>(carried),
    }
}

/// Type name that an existing publish-subscribe service carries.
pub(crate) fn pubsub_type(config: &Config, name: &ServiceName) -> Option<String> {
    let details = ipc::Service::details(name, config, MessagingPattern::PublishSubscribe).ok()??;
    Some(details.static_details.publish_subscribe().message_type_details().payload.type_name().to_string())
}

/// Type names of request and response that an existing request-response service carries.
pub(crate) fn control_types(config: &Config, name: &ServiceName) -> Option<(String, String)> {
    let details = ipc::Service::details(name, config, MessagingPattern::RequestResponse).ok()??;
    let service = details.static_details.request_response();
    Some((
        service.request_message_type_details().payload.type_name().to_string(),
        service.response_message_type_details().payload.type_name().to_string(),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::JointState;

    #[test]
    fn the_older_side_is_the_lower_version() {
        assert_eq!(verdict::<JointState>("rivet.JointState.v2"), Verdict::ThisIsOlder);
        assert_eq!(verdict::<JointState>("rivet.JointState.v10"), Verdict::ThisIsOlder);
        assert_eq!(verdict::<JointState>("rivet.JointState.v0"), Verdict::OtherIsOlder);
        assert_eq!(verdict::<JointState>("rivet.JointState.v1"), Verdict::SameVersionOtherLayout);
        for foreign in ["rivet.Setpoint.v2", "u64", "rivet.JointState", "rivet.JointState.vx", ""] {
            assert_eq!(verdict::<JointState>(foreign), Verdict::OtherMessage, "{foreign}");
        }
    }
}
