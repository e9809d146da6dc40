//! `glasswing simulate`: bench traffic.
