# hpv_twin with Python and make alone: `make help` lists the targets.

PYTHON ?= python3
VENV   ?= .venv
LOCK   ?= requirements/pip.txt
# What `make test` installs beside the package: extras of setup.py, joined by "-".
EXTRAS ?= ros-viewer-study-test

py := $(VENV)/bin/python
# One stamp per set of extras, so that each target installs what it needs, once.
installed := $(VENV)/.installed
comma := ,

# Traffic stays on this machine unless you say otherwise.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
export PIP_DISABLE_PIP_VERSION_CHECK = 1

# ROS from a sourced distribution and ROS from the wheels do not mix in one process.
ifdef AMENT_PREFIX_PATH
unexport AMENT_PREFIX_PATH PYTHONPATH LD_LIBRARY_PATH RMW_IMPLEMENTATION
endif

.SILENT:
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
.PHONY: help twin setpoint given demo replay pictures test test-long coverage colcon lint bench soak lock clean

help: ## this list
	printf 'hpv_twin: a real-time digital twin of a hydropulse vibrator\n\n'
	sed -n 's/^\([a-z-]*\):.*## /\1\t/p' $(firstword $(MAKEFILE_LIST)) | while IFS="$$(printf '\t')" \
	  read -r name what; do printf '  make %-10s %s\n' "$$name" "$$what"; done
	printf '\nPYTHON=python3.12 chooses the Python (3.11 to 3.13), VENV=dir the environment.\n'

twin: $(installed)-ros ## run the twin; ARGS='--ros-args -p pump_flow:=3.65e-4'
	exec $(py) -m hpv_twin twin $(ARGS)

setpoint: given $(installed)-ros ## steer it: FLOW=3.65e-4 (m³/s) PRELOAD=6e-3 (m) LOAD=0 (N), any of them
	exec $(py) -m hpv_twin setpoint $(if $(FLOW),--pump-flow=$(FLOW)) \
	  $(if $(PRELOAD),--preload=$(PRELOAD)) $(if $(LOAD),--load=$(LOAD)) $(ARGS)

# Asked before anything is installed.
given:
	$(if $(FLOW)$(PRELOAD)$(LOAD)$(ARGS),,$(error give FLOW (m³/s), PRELOAD (m) or LOAD (N), \
	  for example: make setpoint FLOW=3.65e-4))

demo: $(installed)-ros-viewer ## a machine, its twin, a fault found, the replay; ARGS='--fault worn_slot'
	exec $(py) -m hpv_twin demo $(ARGS)

replay: $(installed)-viewer ## see the newest recording in rerun; FILE=bags/example.mcap names one
	exec $(py) -m hpv_twin replay $(if $(FILE),'$(FILE)') $(ARGS)

pictures: $(installed)-viewer ## draw docs/images anew from bags/example.mcap; needs a Vulkan driver, no screen
	$(py) docs/images/draw.py

test: lint ## ruff and the tests; ARGS='-k recover' chooses among them
	$(py) -m pytest $(ARGS)

test-long: $(installed)-$(EXTRAS) ## the tests that take minutes
	$(py) -m pytest -m long --timeout=0 $(ARGS)

coverage: $(installed)-$(EXTRAS) ## lines of the model that the tests run, its kernel uncompiled
	NUMBA_DISABLE_JIT=1 $(py) -m pytest -q -m 'not long and not compiled' test/model \
	  --cov=hpv_twin.model --cov-report=term-missing:skip-covered --cov-fail-under=95

colcon: $(installed)-$(EXTRAS) ## is it a ROS package? colcon and pip install it, ros2 run finds it
	$(py) -m pytest -v test/test_package.py $(ARGS)

lint: $(installed)-$(EXTRAS) ## ruff alone
	$(py) -m ruff check

bench: $(installed)-$(EXTRAS) ## all tables: model, node, recorder, studies, calibration, tracking; half an hour
	$(py) bench/model_speed.py
	$(py) bench/node_rate.py
	$(py) bench/setpoint_response.py
	$(py) bench/under_fire.py
	$(py) bench/studies.py
	$(py) bench/replay_speed.py
	$(py) bench/recorder_cost.py
	$(py) bench/calibration.py
	$(py) bench/frequency_hold.py
	$(py) bench/tracking.py
	$(py) bench/fault_matrix.py

MINUTES ?= 20
soak: $(installed)-$(EXTRAS) ## the twin for MINUTES=20: memory, gaps, lateness, drift
	exec $(py) bench/soak.py --minutes $(MINUTES)

lock: $(VENV)/bin/pip ## write requirements/*.txt anew, with today's versions
	$(py) -m pip install --quiet uv
	$(py) -m uv pip compile --quiet --universal --python-version 3.11 --all-extras --upgrade \
	  --custom-compile-command 'make lock' --output-file requirements/pip.txt setup.py
	$(py) -m uv pip compile --quiet --python-version 3.12 --python-platform linux --upgrade \
	  --extra ros --extra study --extra parquet --extra test --constraints requirements/noble.in \
	  --custom-compile-command 'make lock' --output-file requirements/noble.txt setup.py

clean: ## remove what was built and installed here; recordings stay
	rm -rf .venv* build install log *.egg-info .pytest_cache .ruff_cache .hypothesis
	find hpv_twin test bench launch -name __pycache__ -prune -exec rm -rf {} + 2>/dev/null || true

$(installed)-%: setup.py $(LOCK) | $(VENV)/bin/pip
	echo 'Installing hpv_twin with $(subst -, and ,$*) into $(VENV): hundreds of MB the first time.'
	$(py) -m pip install --constraint $(LOCK) --editable '.[$(subst -,$(comma),$*)]'
	touch $@

# pip comes last: an environment without it was cut short, and is made anew.
$(VENV)/bin/pip:
	command -v $(PYTHON) >/dev/null || { echo 'make: no $(PYTHON) here.' \
	  'Install Python 3.11 to 3.13, or name one: make … PYTHON=/path/to/python' >&2; exit 1; }
	$(PYTHON) -c 'import sys; v = sys.version_info; (3, 11) <= v < (3, 14) or sys.exit( \
	  "make: $(PYTHON) is Python %d.%d; hpv_twin runs on 3.11 to 3.13. Name another one: " \
	  "make … PYTHON=python3.12" % v[:2])'
	$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo 'make: $(PYTHON) cannot make' \
	  'virtual environments. On Debian and Ubuntu: sudo apt install python3-venv' >&2; exit 1; }
	$(PYTHON) -m venv --clear $(VENV)
