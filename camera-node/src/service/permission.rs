//! Who may call what: a node obeys the coordinators of its room, and tells viewers its health.

use std::sync::Arc;

use net::Identity;
use net::admission::RateLimitedLog;
use tonic::{Request, Status};

use super::incoming::{Access, Caller};

/// Lets only some callers through.
#[derive(Clone)]
pub(super) struct Permission {
    /// Owners whose certificates allow the call; `None`: every admitted connection may call.
    allowed: Option<Vec<Identity>>,
    log: Arc<RateLimitedLog>,
}

impl Permission {
    /// The permission of coordinators.
    pub fn to_lead(access: &Access) -> Permission {
        Permission::of(access, |room| vec![Identity::coordinator(room)])
    }

    /// Coordinators and viewers.
    pub fn to_look(access: &Access) -> Permission {
        Permission::of(access, |room| vec![Identity::coordinator(room), Identity::viewer(room)])
    }

    fn of(access: &Access, allowed: impl Fn(&str) -> Vec<Identity>) -> Permission {
        let allowed = match access {
            Access::Certified(credentials) => Some(allowed(&credentials.own().room)),
            Access::ThisMachine | Access::AnyPeer => None,
        };
        Permission { allowed, log: Arc::default() }
    }
}

impl tonic::service::Interceptor for Permission {
    fn call(&mut self, request: Request<()>) -> Result<Request<()>, Status> {
        let Some(allowed) = &self.allowed else { return Ok(request) };
        let Some(caller) = request.extensions().get::<Caller>() else {
            return Err(Status::permission_denied("the caller has no identity"));
        };
        // Over a Unix socket there are no certificates: the mode of its file admits this user alone.
        let Some(peer) = &caller.peer else { return Ok(request) };
        if allowed.iter().any(|identity| peer.is(identity)) {
            return Ok(request);
        }
        let allowed: Vec<String> = allowed.iter().map(Identity::to_string).collect();
        let why = format!("this is for {}, and was asked by {peer}", allowed.join(" or "));
        self.log.warn(&"a call was refused", &why);
        Err(Status::permission_denied(why))
    }
}
