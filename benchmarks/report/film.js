// Films: one tall image each, of which the frame at the slider is shown. Nothing moves by itself.
"use strict";
const PAUSE_MS = 200;
const HOLD = 7; // ticks at the last frame before it starts over
const films = [...document.querySelectorAll(".film")].map((image) => {
  const controls = image.nextElementSibling;
  const film = {
    image,
    button: controls.querySelector("button"),
    slider: controls.querySelector("input"),
    frames: Number(image.dataset.frames),
    playing: false,
    held: 0,
  };
  controls.hidden = false;
  film.slider.addEventListener("input", () => { play(film, false); show(film); });
  film.button.addEventListener("click", () => play(film, !film.playing));
  return film;
});
const all = document.querySelector(".play-all");

function show(film) {
  const share = film.frames > 1 ? film.slider.value / (film.frames - 1) : 1;
  film.image.style.objectPosition = `0 ${100 * share}%`;
}

function play(film, on) {
  film.playing = on;
  film.held = 0;
  film.button.textContent = on ? "Pause" : "Play";
  if (on && Number(film.slider.value) === film.frames - 1) film.slider.value = 0;
  show(film);
  if (all) all.textContent = films.some((each) => each.playing) ? "Pause all" : "Play all";
}

if (all && films.length) {
  all.hidden = false;
  all.addEventListener("click", () => {
    const on = !films.some((each) => each.playing);
    films.forEach((film) => play(film, on));
  });
}
setInterval(() => {
  for (const film of films) {
    if (!film.playing) continue;
    if (Number(film.slider.value) < film.frames - 1) {
      film.slider.value = Number(film.slider.value) + 1;
    } else if (++film.held > HOLD) {
      film.held = 0;
      film.slider.value = 0;
    }
    show(film);
  }
}, PAUSE_MS);
