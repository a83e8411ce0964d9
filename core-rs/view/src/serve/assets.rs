//! The files of the page, which are compiled into the library.

macro_rules! page {
    ($($name:literal)*) => {
        &[$(($name, include_str!(concat!("../../page/", $name)))),*]
    };
}

const PAGE_FILES: &[(&str, &str)] = page!(
    "index.html" "style.css" "icon.svg" "main.js" "alignment.js" "bundle.js" "camera.js" "chunks.js" "clock.js" "connection.js" "controls.js" "draw.js" "events.js"
    "flashes.js" "flights.js" "frames.js" "gl.js" "hands.css" "hands.html" "hands.js" "inputs.js" "inspector.js" "labels.js" "lane.js" "live.js" "model.js" "motion.js" "packed.js" "shaders.js" "sound.js" "story.js"
    "timeline.js" "tour.js"
);

/// A file of the page: its media type and its text. The empty name is `index.html`.
pub(super) fn find_asset(file_name: &str) -> Option<(&'static str, &'static str)> {
    let file_name = if file_name.is_empty() { "index.html" } else { file_name };
    let &(file_name, file_text) = PAGE_FILES.iter().find(|(known, _)| *known == file_name)?;
    let media_type = match file_name.rsplit_once('.')?.1 {
        "html" => "text/html; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "svg" => "image/svg+xml",
        _ => "text/javascript; charset=utf-8",
    };
    Some((media_type, file_text))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::Path;

    use super::*;

    #[test]
    fn served_files_are_those_of_the_folder() {
        let page_folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("page");
        let folder_files = std::fs::read_dir(page_folder).expect("the folder");
        let folder_files: BTreeSet<_> = folder_files
            .map(|entry| entry.expect("an entry").file_name().into_string().expect("a name"))
            .collect();
        let served_files = PAGE_FILES.iter().map(|(name, _)| (*name).to_owned()).collect();
        assert_eq!(folder_files, served_files);
    }
}
