//! The conversation with a controller, over any stream.

use std::io::{ErrorKind, Read, Write};

use crate::package::{ControllerVersion, Frames, PROTOCOL, RtdeError, TextMessage, encode, kind, outputs};
use crate::recipe::{Recipe, Values};

/// What the caller does while an answer is awaited.
pub trait Listener {
    /// Whether to wait on. Asked after each package and after each read that brought nothing.
    fn waits(&mut self) -> bool;
    /// A text of the controller came.
    fn text(&mut self, message: &TextMessage);
}

/// What [`Client::poll`] found.
#[derive(Debug)]
pub enum Event<'a> {
    /// Values of the recipe.
    Data(Values<'a>),
    /// A text of the controller.
    Text(TextMessage),
    /// A package that has no meaning here, by its type; or data of another recipe.
    Ignored(u8),
    /// Nothing has come within the stream's time-out.
    Nothing,
}

/// A client that reads outputs.
///
/// The stream may have a time-out: a read that brings nothing is no error. Allocates only while a recipe is agreed on and for texts.
#[derive(Debug)]
pub struct Client<S> {
    stream: S,
    frames: Frames,
    recipe: Option<Recipe>,
}

impl<S: Read + Write> Client<S> {
    /// Agrees on protocol version 2.
    ///
    /// # Errors
    /// The version is not accepted; no sound answer came.
    pub fn connect(stream: S, listener: &mut dyn Listener) -> Result<Client<S>, RtdeError> {
        let mut client = Client { stream, frames: Frames::new(), recipe: None };
        match client.ask(kind::PROTOCOL_VERSION, &PROTOCOL.to_be_bytes(), listener)?[..] {
            [1] => Ok(client),
            [_] => Err(RtdeError::Protocol),
            _ => Err(RtdeError::malformed(kind::PROTOCOL_VERSION, "one byte was expected")),
        }
    }

    /// The version of the controller's software.
    ///
    /// # Errors
    /// No sound answer came.
    pub fn version(&mut self, listener: &mut dyn Listener) -> Result<ControllerVersion, RtdeError> {
        ControllerVersion::decode(&self.ask(kind::CONTROLLER_VERSION, &[], listener)?)
    }

    /// Asks for output fields at `rate_hz` \[Hz\]. The recipe also says which of them the controller does not know.
    ///
    /// # Errors
    /// No sound answer came.
    pub fn set_up(&mut self, rate_hz: f64, names: &[&str], listener: &mut dyn Listener) -> Result<Recipe, RtdeError> {
        let answer = self.ask(kind::SETUP_OUTPUTS, &outputs(rate_hz, names), listener)?;
        let recipe = Recipe::decode(names, &answer)?;
        self.recipe = Some(recipe.clone());
        Ok(recipe)
    }

    /// Starts the data packages.
    ///
    /// # Errors
    /// The controller refuses; no sound answer came.
    pub fn start(&mut self, listener: &mut dyn Listener) -> Result<(), RtdeError> {
        match self.ask(kind::START, &[], listener)?[..] {
            [1] => Ok(()),
            _ => Err(RtdeError::Refused { kind: kind::START }),
        }
    }

    /// Asks for a pause, and waits for no answer: what a client does before it leaves.
    ///
    /// # Errors
    /// The stream failed.
    pub fn pause(&mut self) -> Result<(), RtdeError> {
        self.send(kind::PAUSE, &[])
    }

    /// The next package. Reads at most once.
    ///
    /// # Errors
    /// The stream failed or has ended; a package that is malformed.
    pub fn poll(&mut self) -> Result<Event<'_>, RtdeError> {
        let Some(size) = self.fill()? else { return Ok(Event::Nothing) };
        let (package, payload) = self.frames.take(size);
        match (package, &self.recipe) {
            (kind::DATA, Some(recipe)) => Ok(recipe.values(payload)?.map_or(Event::Ignored(package), Event::Data)),
            (kind::TEXT_MESSAGE, _) => Ok(Event::Text(TextMessage::decode(payload)?)),
            _ => Ok(Event::Ignored(package)),
        }
    }

    fn send(&mut self, request: u8, payload: &[u8]) -> Result<(), RtdeError> {
        Ok(self.stream.write_all(&encode(request, payload)?)?)
    }

    /// Size of the next package once it is there as a whole, with one read at most.
    fn fill(&mut self) -> Result<Option<usize>, RtdeError> {
        if let Some(size) = self.frames.ready()? {
            return Ok(Some(size));
        }
        match self.stream.read(self.frames.room()) {
            Ok(0) => Err(RtdeError::Closed),
            Ok(count) => {
                self.frames.filled(count);
                self.frames.ready()
            }
            Err(why) if matches!(why.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) => {
                Ok(None)
            }
            Err(why) => Err(why.into()),
        }
    }

    /// Sends a request and waits for the package of the same type.
    fn ask(&mut self, request: u8, payload: &[u8], listener: &mut dyn Listener) -> Result<Vec<u8>, RtdeError> {
        self.send(request, payload)?;
        while listener.waits() {
            let Some(size) = self.fill()? else { continue };
            let (came, payload) = self.frames.take(size);
            if came == request {
                return Ok(payload.to_vec());
            }
            if came == kind::TEXT_MESSAGE {
                listener.text(&TextMessage::decode(payload)?);
            }
        }
        Err(RtdeError::NoAnswer { kind: request })
    }
}
