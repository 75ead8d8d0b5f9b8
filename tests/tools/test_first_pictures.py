"""The pictures of the site's first page are on it, and their captions agree with them."""

import first_pictures

_PAGE = first_pictures.FOLDER.parents[1] / "index.md"


def test_the_first_page_shows_all_pictures_of_its_steps() -> None:
    text = _PAGE.read_text(encoding="utf-8")
    drawn = {path.name for path in first_pictures.FOLDER.glob("*.png")}
    assert drawn == {"step.png", "batch.png", "train.png", "evaluate.png"}
    for name in drawn:
        assert f"](images/first/{name})" in text


def test_the_caption_names_the_steps_that_are_drawn() -> None:
    *steps, last = first_pictures.STEPS
    told = f"after {', '.join(map(str, steps))} and {last} steps"
    assert told in _PAGE.read_text(encoding="utf-8")
