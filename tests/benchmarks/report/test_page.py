from __future__ import annotations

import base64
from html.parser import HTMLParser

from benchmarks.report.page import Markup, element, image, page, void


def test_text_and_attributes_are_escaped_and_markup_is_not():
    made = element("p", "a < b & c", Markup("<b>x</b>"), title='say "no" <')
    assert made == '<p title="say &quot;no&quot; &lt;">a &lt; b &amp; c<b>x</b></p>'


def test_lists_are_flattened_and_none_is_nothing():
    assert element("ul", [element("li", "1"), None, [element("li", "2")]], class_=None) == (
        "<ul><li>1</li><li>2</li></ul>"
    )


def test_an_elements_without_content_has_no_end():
    assert void("img", alt="x") == '<img alt="x">'


def test_an_image_holds_its_own_content_and_a_description():
    made = image(b"\x00\xff", "png", 'a "map"')
    assert base64.b64encode(b"\x00\xff").decode() in made
    assert 'alt="a &quot;map&quot;"' in made


class Tags(HTMLParser):
    """Notes which elements are open at the end, and what refers to other places."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.addresses: list[str] = []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        if tag not in ("meta", "link", "img", "input"):
            self.open.append(tag)
        if "id" in given:
            self.ids.append(given["id"])
        self.addresses += [given[name] for name in ("href", "src") if name in given]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_a_page_is_well_formed_and_its_links_lead_to_its_own_sections():
    tags = Tags()
    tags.feed(page("T", element("p", "s"), [("one", "One", "text"), ("two", "Two", None)]))
    assert tags.open == []
    assert len(set(tags.ids)) == len(tags.ids)
    inside = [address for address in tags.addresses if address.startswith("#")]
    assert inside == ["#main", "#one", "#two"]
    assert {address.removeprefix("#") for address in inside} <= set(tags.ids)
    assert all(address.startswith(("#", "data:")) for address in tags.addresses)
