//! Integration tests.

mod replies;
