# One list of tasks; CI calls them by the same names.
#   make demo       build, render a bundled score to a WAV, say where and how fast, play it if it can
#   make test       everything that must hold (random cases by a fixed seed: no luck in a landing); installs the programs that tests
#                   start, or skips these tests and names them. SKIPS=fail: a skipped test is a failed one, as in .ci/run
#   make test-terminal  the quick half of what is printed, in the plainest locale and a terminal of 80 columns
#   make check      format, lint, types, Rust documentation, workflows; warnings are errors
#   make bench      speeds, as ratios to references measured in the same run (docs/benchmarks.md)
#   make ear        what each instrument is taken for, and how far it lies from recordings (docs/ear.md; minutes)
#   make docs       pages that are made from the program: what errors mean, the fields, the verbs, faults, licences
#   make charts     pictures of error against cost, of stability (docs/charts), and of the pieces (docs/gallery)
#   make media      the film, the sounds and the still of the prompt on README.md (docs/pictures, docs/sounds; a few minutes)
#   make site       the pages as a site with search, into out/site; a link that leads nowhere ends it
#   make pieces     pages that move and sound of some pieces, into out/pieces; `make site` then links them in the gallery (minutes)
#   make accuracy   what plans say of their errors beside what these are (docs/accuracy.md); minutes. FAMILIES=dry,key: of these alone
#   make movie      a minute of a bundled piece as a film for headphones, into out/ (minutes without a graphics card)
#   make man        manual pages of all commands, into out/man; `ergon completion SHELL` completes from the same table
#   make vsix       the extension of VS Code as a file to install, into out/ (needs npm and the network)
#   make wheel      a wheel for others: any Linux with glibc 2.28 or newer (manylinux_2_28), into out/
#   make audit      known faults, licences and sources of what is built in (needs the network)
#   make test-long  the minutes-long tests, random cases drawn anew, and `make demo` and `make test` in a bare Debian
#   make miri       pure parts of the core under Miri, which finds undefined behaviour (needs a nightly Rust; minutes)

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SUDO := $(shell test "$$(id -u)" = 0 || echo sudo)
PYTEST := $(BIN)/python -m pytest -q --numprocesses auto
SKIPS ?= say
# The quick half of the tests that read what is printed.
PRINTING := tests/notation tests/lsp $(patsubst %,tests/cli/test_%.py,cli_app cli_fold cli_layout cli_modes cli_names cli_plan cli_render cli_score \
  cli_stats cli_streams cli_take every_command tables terminal_text)
NO_SKIPS := $(if $(filter fail,$(SKIPS)),--no-skips)
RUST := $(shell find core-rs -name '*.rs' -not -path '*/target/*') Cargo.toml Cargo.lock $(wildcard core-rs/*/Cargo.toml)

.PHONY: demo test test-rust test-python test-programs test-terminal test-bare check check-rust check-python check-workflows audit bench ear docs charts media site pieces accuracy movie man vsix wheel test-long miri clean

demo: $(VENV)/built
	@mkdir -p out
	$(BIN)/ergon demo -o out/demo.wav --force

# Side by side: one computes where the other waits.
test: test-programs
	$(MAKE) --jobs=2 test-rust test-python

test-rust:
	MAKEFLAGS= PROPTEST_RNG_SEED=1 cargo test --locked --quiet

test-python: $(VENV)/dev
	MAKEFLAGS= CI=true $(PYTEST) -m "not slow" --dist loadfile --no-loadscope-reorder $(NO_SKIPS)

test-programs:
	@$(PYTHON) tests/support/programs.py

# LANG=C: the locale of a machine that nobody has set up.
test-terminal: $(VENV)/dev
	MAKEFLAGS= CI=true LANG=C TERM=xterm COLUMNS=80 LINES=24 $(PYTEST) -m "not slow" --dist loadfile $(NO_SKIPS) $(PRINTING)

test-bare:
	tests/bare_debian.sh

test-long: $(VENV)/dev
	PROPTEST_CASES=4096 cargo test --locked --release
	cargo test --locked --release -p ergon-live --lib -- --ignored
	cargo test --locked --release -p ergon-engine --test no_alloc --test scenes -- --ignored
	$(PYTEST) --dist worksteal
	$(MAKE) test-bare accuracy

# Without the tests that draw many numbers or sounds: Miri takes a thousand times as long.
miri:
	@if cargo +nightly miri --version >/dev/null 2>&1; then \
	  PROPTEST_CASES=1 MIRIFLAGS="-Zmiri-disable-isolation" cargo +nightly miri test --locked -p ergon-engine --lib -- \
	    archive:: interrupt:: kernel::thread_team law::runs --skip moments; \
	else \
	  echo "Miri comes with a nightly Rust: rustup toolchain install nightly --component miri. Nothing was tried."; \
	fi

check: check-rust check-python check-workflows

check-rust:
	cargo fmt --all --check
	cargo clippy --locked --workspace --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps --workspace --quiet

check-python: $(VENV)/dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest ergon._core --allowlist tests/data/stubs-allowed.txt

check-workflows: $(VENV)/dev
	$(BIN)/check-jsonschema --quiet --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(BIN)/check-jsonschema --quiet --builtin-schema vendor.dependabot .github/dependabot.yml
	$(BIN)/zizmor --offline --quiet --no-progress .github

# No part of `check`: advisories come from the network, and change without a change here.
audit: $(VENV)/dev
	@command -v cargo-deny >/dev/null || cargo install --locked cargo-deny
	cargo deny --locked check advisories licenses bans sources
	@test -x $(VENV)-audit/bin/pip-audit || { $(PYTHON) -m venv $(VENV)-audit && \
	  $(VENV)-audit/bin/pip install --quiet pip-audit; }
	$(BIN)/pip list --format=freeze --exclude-editable | grep -v '^pip==' > $(VENV)-audit/all.txt
	$(VENV)-audit/bin/pip-audit --strict --no-deps --disable-pip -r $(VENV)-audit/all.txt

bench: $(VENV)/dev
	$(BIN)/python -m benches

ear: $(VENV)/dev
	$(BIN)/python -m benches ear --page

docs: $(VENV)/dev
	$(BIN)/python -m docs.generators.error_pages docs/errors
	$(BIN)/python -m docs.generators.reference docs/reference.md
	$(BIN)/python -m docs.generators.faults docs/faults.md
	$(BIN)/python -m docs.generators.howto_pictures
	$(BIN)/python -m docs.generators.hand_paths docs/howto/hands.md
	$(BIN)/python -m docs.generators.haptic
	$(BIN)/python -m docs.generators.cards docs/instruments
	$(BIN)/python -m docs.generators.ideas docs/ideas.md
	$(BIN)/python -m ergon.repl.language.help docs/cheat-sheet.md
	$(BIN)/python -m docs.generators.verb_methods repl/session/verb_methods.pyi
	$(BIN)/python core-rs/third_party.py LICENSE-THIRD-PARTY

charts: $(VENV)/dev
	$(BIN)/python -m ergon.workshop.lab.bundled docs/charts
	$(BIN)/python -m docs.generators.gallery

media: $(VENV)/dev
	$(BIN)/python -m docs.generators.sounds docs/sounds
	PYTHONPATH=tests/support $(BIN)/python -m docs.generators.prompt_picture docs/pictures/prompt.svg
	$(BIN)/python -m docs.generators.film docs/pictures/galaxy.webp

site: $(VENV)/dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

pieces: $(VENV)/dev
	$(BIN)/python -m docs.generators.shared_pieces out/pieces

accuracy: $(VENV)/dev
	PYTHONPATH=tests/support $(BIN)/python -m accuracy docs/accuracy.md $(FAMILIES)

movie: $(VENV)/dev
	@mkdir -p out
	$(BIN)/ergon view scores/library/feathers-small.yaml --movie out/feathers.webm --from 175s --until 235s --camera '1@175s 3@190s 1@215s 2@235s' --force

man: $(VENV)/dev
	$(BIN)/python -m docs.generators.man out/man

vsix:
	@rm -rf out/vscode && mkdir -p out && cp -r editors/vscode out/vscode
	@cat LICENSE-MIT LICENSE-APACHE > out/vscode/LICENSE.txt
	cd out/vscode && npm ci --ignore-scripts --no-audit --no-fund && \
	  npx --yes @vscode/vsce@4 package --allow-missing-repository --out ../ergon.vsix

# Linked against an old glibc by zig: what is linked here asks for the glibc of this machine. It needs nothing of the package's
# environment: one of its own holds maturin and zig, which maturin looks for by the first `python3` on the PATH. build.json
# says which commit `ergon --version` names.
wheel:
	@test -x $(VENV)-wheel/bin/pip || $(PYTHON) -m venv $(VENV)-wheel
	$(VENV)-wheel/bin/pip install --quiet "maturin[zig]>=1.16,<2"
	$(VENV)-wheel/bin/python -m docs.generators.build_record ergon/api/build.json
	PATH="$(abspath $(VENV)-wheel/bin):$$PATH" maturin build --release --zig --compatibility manylinux_2_28 --out out; \
	  code=$$?; rm -f ergon/api/build.json; exit $$code

# The package in an environment of its own; rebuilt when the Rust changes. Python and YAML are live.
$(VENV)/built: pyproject.toml $(RUST)
	@test -x $(BIN)/pip || $(PYTHON) -m venv $(VENV) || \
	  { echo "Debian keeps venv in a package of its own: installing python3-venv"; \
	    $(SUDO) sh -c 'apt-get update -qq && apt-get install -y -q python3-venv' && $(PYTHON) -m venv $(VENV); }
	$(BIN)/pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet --editable .
	@touch $@

$(VENV)/dev: $(VENV)/built
	$(BIN)/pip install --quiet --group dev
	@touch $@

clean:
	rm -rf target $(VENV) $(VENV)-audit $(VENV)-wheel out
