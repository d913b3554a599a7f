//! What a function of the library returns, and its text.

/// What a function returns. Negative values are errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub enum Status {
    /// Done; an output is valid.
    Ok = 0,
    /// Nothing has arrived yet; the output is unchanged.
    None = 1,
    /// The value is older than asked for; the output has it.
    Stale = 2,
    /// A pointer is NULL or a value breaks a rule.
    Argument = -1,
    /// The program was compiled with the header of another version of the library.
    Version = -2,
    /// The bus could not be opened.
    Bus = -3,
    /// The queue is full, so the sample is lost; the library's thread gets no processor time.
    Full = -4,
    /// The library's thread has ended; close and open again.
    Ended = -5,
    /// An error inside the library.
    Internal = -6,
}

impl Status {
    /// The status with this number.
    pub fn from_number(number: i32) -> Option<Status> {
        use Status::{Argument, Bus, Ended, Full, Internal, None, Ok, Stale, Version};
        let all = [Ok, None, Stale, Argument, Version, Bus, Full, Ended, Internal];
        all.into_iter().find(|status| *status as i32 == number)
    }

    /// One sentence about it, without a full stop, that ends with a zero byte for C.
    pub(crate) const fn text(self) -> &'static std::ffi::CStr {
        match self {
            Status::Ok => c"done",
            Status::None => c"nothing has arrived yet",
            Status::Stale => c"the value is older than asked for",
            Status::Argument => c"a pointer is NULL or a value breaks a rule",
            Status::Version => {
                c"the program was compiled with the header of another version of librivet; compile it again"
            }
            Status::Bus => c"the bus could not be opened; rivet_error has the reason",
            Status::Full => c"the queue is full and the sample is lost; the thread of librivet gets no processor time",
            Status::Ended => c"the thread of librivet has ended; close the robot and open it again",
            Status::Internal => c"error inside librivet",
        }
    }
}
