//! From a marker file to a pose of each link in each frame by itself: which markers are a link's
//! (`layout`), the rigid pose that they give (`rigid`), and what to do where one of them is
//! wrong (`labels`).

pub mod labels;
pub mod layout;
pub mod rigid;
