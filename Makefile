# make setup | test | test-long | test-haswell | lint | demo | paper | paper-quick | bench-rtde | bench-graph | bench-speed | bench-stats | bench-drift | bench-online | bench-robots | bench-batch | bench-fleet | clean
# Every target sets up what it needs. Needs Python 3.11 or 3.12 with venv and headers, gcc, g++, make and a Python package index.

VENV := .venv
RUN := setup/run
WS := ros2_ws

# Files whose change needs a rebuild. Python modules are not among them: they are linked, not copied.
BUILD_INPUTS := $(shell find $(WS)/src -type f \( -name '*.msg' -o -name '*.action' -o -name CMakeLists.txt -o -name package.xml \
	-o -name setup.py -o -name setup.cfg -o -path '*/launch/*.py' -o -path '*/joint_id_ros/config/*' -o -path '*/resource/*' \) 2>/dev/null)
BUILD_TOOLS := setup/build.sh setup/launchers.py setup/drop_missing_includes.cmake

PACKAGES := $(wildcard $(WS)/src/joint_id_core/joint_id_core $(WS)/src/joint_id_ros/joint_id_ros)
UNIT_TESTS := $(wildcard $(WS)/src/joint_id_core/test)
NODE_TESTS := $(wildcard $(WS)/src/joint_id_ros/test tests)
# Whose nodes stream at 500 Hz or run against a clock; the longest file first, in both lists.
TIMED_TESTS := $(addprefix tests/test_,demo.py driver.py driver_faults.py chain.py demo_end.py)
LONG_FILES := $(addprefix tests/test_,identifier_node.py measured_regression.py stopping.py examples.py graph_faults.py fleet.py \
	arm_identifier_node.py identify_node.py doc_commands.py knowledge_node.py graph_nodes.py filter_load.py official_driver.py player.py \
	filter_node.py watch_node.py doctor_ros.py docs.py identifier_start.py)
ALL_LONG := $(shell grep -l '^pytestmark = pytest.mark.long' tests/test_*.py)# no quick test in them: not even imported
OTHER_FILES := $(filter-out $(TIMED_TESTS) $(LONG_FILES) $(ALL_LONG),$(wildcard $(NODE_TESTS:%=%/test_*.py)))

.PHONY: all setup test test-long test-haswell lint demo paper paper-quick bench-rtde bench-graph bench-cancel bench-speed bench-stats bench-drift bench-online bench-robots bench-batch bench-fleet clean
all: setup

setup: $(WS)/install/.built

$(VENV)/.made:
	@set -e; python=$$(sh setup/find_python.sh); echo "creating $(VENV) with $$python"; \
	"$$python" -m venv --clear $(VENV); touch $@

$(VENV)/.installed: $(VENV)/.made requirements.txt constraints.txt
	@echo "installing requirements into $(VENV) (some minutes the first time)"
	@$(VENV)/bin/python -m pip install -qq -r requirements.txt -c constraints.txt
	@touch $@

$(WS)/install/.built: $(VENV)/.installed $(BUILD_INPUTS) $(BUILD_TOOLS)
	@sh setup/build.sh $(VENV)
	@touch $@

# Linear algebra takes one core a process: threads of tests that run side by side would wait for each other.
test test-long test-haswell: export OMP_NUM_THREADS := 1
# Bytecode is kept, whatever the environment says: tests start hundreds of processes, and each would compile all of its modules.
unexport PYTHONDONTWRITEBYTECODE

# Everything that users rely on, quick tests first. Those whose nodes stream at 500 Hz or run against a clock come last.
# Some unit tests wait for a process, and nodes wait more than they compute: so three and four run at once.
test: setup
	$(RUN) python -m pytest -n 3 --dist worksteal --durations=10 -m "not long" $(UNIT_TESTS)
	$(RUN) python -m pytest -n 4 --dist loadfile --no-loadscope-reorder --durations=10 -m "not long" $(LONG_FILES) $(OTHER_FILES)
	$(RUN) python -m pytest -n 3 --dist loadfile --no-loadscope-reorder --durations=10 -m "not long" $(TIMED_TESTS)

# The tests marked "long" (40 minutes): what costs most for what it tells, and what guards only benchmarks/
# and the study of the paper; the numeric ones also as on another processor; then ten times as many examples of Hypothesis.
test-long: setup $(VENV)/.paper
	$(RUN) python -m pytest -n 2 --dist loadfile --durations=10 -m long $(UNIT_TESTS) $(NODE_TESTS)
	$(RUN) setup/haswell python -m pytest -n 2 --dist worksteal -m long $(NUMERIC_FILES)
	MORE_EXAMPLES=10 $(RUN) python -m pytest -n 2 -m "hypothesis and not long" $(UNIT_TESTS) $(NODE_TESTS)

# The numeric unit tests as on a processor without AVX-512, as most laptops are: LAPACK, sums and kernels round differently there.
NUMERIC_TESTS := arm_fit arm_joint_estimates arm_suspects batch between_samples changes combinations constancy cross_check drift drive_noise early_change esdirk fit_data fleet follower gauss_newton held_out hidden_gear hop information innovations innovations_verdicts instruments lacking late_sensor \
	levels load_size matched_load memory messages motion_watch \
	misfit noise one_encoder online online_checks online_errors online_gear online_input_noise pending_changes pick_and_place presliding processor ranking recorded_motion recursion regression resume rounding second_look since_change sizes sliding slow_parts standing starts stillness stretch translate vanishing voltage_sizes whiteness
NUMERIC_FILES = $(NUMERIC_TESTS:%=$(UNIT_TESTS)/test_%.py)
test-haswell: setup
	$(RUN) setup/haswell python -m pytest -n 2 --dist worksteal -m "not long" $(NUMERIC_FILES)

lint: setup
	$(RUN) ruff check .
	$(RUN) ruff format --check .
	$(RUN) mypy $(PACKAGES)

demo: setup
	$(RUN) python demo/demo.py

# DeepXDE, which only the study of the paper needs. If it cannot be installed, its rows are left out.
$(VENV)/.paper: $(VENV)/.installed benchmarks/requirements-paper.txt benchmarks/constraints.txt constraints.txt
	@$(VENV)/bin/python -m pip install -qq -r benchmarks/requirements-paper.txt -c benchmarks/constraints.txt \
		-c constraints.txt && touch $@ || echo "benchmarks/requirements-paper.txt could not be installed: continuing without it"

# The study of the paper writes docs/paper.md (an hour); paper-quick runs every row once at reduced size (two minutes).
paper: setup $(VENV)/.paper
	$(RUN) python benchmarks/paper.py

paper-quick: setup $(VENV)/.paper
	$(RUN) python benchmarks/paper.py --quick --out out/paper

# Ten minutes of a robot at 500 Hz through each client, then every fault that the emulator knows, through the driver.
bench-rtde: setup
	$(RUN) python benchmarks/rtde_loss.py
	$(RUN) python benchmarks/rtde_faults.py

# What emulator, driver, filter and identifier cost, and how late an estimate is (eight minutes).
bench-graph: setup
	$(RUN) python benchmarks/graph.py --runs 3

# How soon a cancelled identification stops the emulated robot (ten minutes).
bench-cancel: setup
	$(RUN) python benchmarks/cancel.py

# Libraries that only the benchmarks need. A missing library is shown as missing, so a failure here is not an error.
$(VENV)/.peers: $(VENV)/.installed benchmarks/requirements.txt benchmarks/constraints.txt constraints.txt
	@$(VENV)/bin/python -m pip install -qq -r benchmarks/requirements.txt -c benchmarks/constraints.txt \
		-c constraints.txt && touch $@ || echo "benchmarks/requirements.txt could not be installed: continuing without it"

# The engine against a kernel in C++ (a few minutes), then other libraries on the same fits (half an hour).
bench-speed: setup $(VENV)/.peers
	$(RUN) python benchmarks/speed.py --json out/benchmarks/speed.json
	$(RUN) python benchmarks/speed_peers.py --json out/benchmarks/speed_peers.json
	$(RUN) python benchmarks/batched.py --json out/benchmarks/batched.json

# Errors against their predicted sigma, coverage of the intervals, and the paper's methods on the same data.
bench-stats: setup
	$(RUN) python benchmarks/stats.py --json out/benchmarks/stats.json
	$(RUN) python benchmarks/arm_stats.py --arms 60 --json out/benchmarks/arm_stats.json --write

# Run lengths of the drift monitor: writes its tables into docs/reliability.md (twenty minutes).
bench-drift: setup
	$(RUN) python benchmarks/drift.py --json out/benchmarks/drift.json --write docs/reliability.md

# What the online engine does when a joint changes or a sensor fails, hours without a change, other methods (two hours on two cores);
# then two hours of six joints through all nodes.
bench-online: setup $(VENV)/.peers
	$(RUN) python benchmarks/online.py --docs
	$(RUN) python benchmarks/online_peers.py --docs
	$(RUN) python benchmarks/soak.py --minutes 120 --docs

# Other tools for a whole arm: see benchmarks/requirements-arm.txt. What is missing is shown as missing.
$(VENV)/.arm_peers: $(VENV)/.installed benchmarks/requirements-arm.txt benchmarks/constraints.txt constraints.txt
	@$(VENV)/bin/python -m pip install -qq -r benchmarks/requirements-arm.txt -c benchmarks/constraints.txt \
		-c constraints.txt && touch $@ || echo "benchmarks/requirements-arm.txt could not be installed: continuing without it"

# Both estimators, plain least squares and other tools on public recordings of real robots, expected in ../shared/data; what is not
# there is skipped (three minutes). With --docs it writes the tables of docs/real_robots.md.
bench-robots: setup $(VENV)/.arm_peers
	$(RUN) python benchmarks/robots.py --json out/benchmarks/robots.json

# A thousand simulated bags on two cores (five minutes on a quiet computer): writes its table into docs/benchmarks.md.
bench-batch: setup
	$(RUN) python benchmarks/batch.py --json out/benchmarks/batch.json --docs

# Many live robots in one process, in two, and in one a node; the page of all; discovery (twenty minutes). Writes the tables of docs/fleet.md.
bench-fleet: setup
	$(RUN) python benchmarks/fleet.py --docs

clean:
	rm -rf $(VENV) $(WS)/build $(WS)/install $(WS)/log out .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
