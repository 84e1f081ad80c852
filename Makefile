# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0

PYTHON ?= python3
NAME ?=
VENV := .venv
BIN := $(VENV)/bin
# Written last, so that an interrupted installation is taken up again.
READY := $(VENV)/ready

# The wheels of ROS look here for their message types; a sourced workspace comes first.
export AMENT_PREFIX_PATH := $(if $(AMENT_PREFIX_PATH),$(AMENT_PREFIX_PATH):)$(CURDIR)/$(VENV)

# What the wheel of Open3D links against without bringing it, as library:package of Debian.
LIBRARIES := \
	libEGL.so.1:libegl1 \
	libGL.so.1:libgl1 \
	libX11.so.6:libx11-6 \
	libgomp.so.1:libgomp1 \
	libidn2.so.0:libidn2-0 \
	libudev.so.1:libudev1 \
	libusb-1.0.so.0:libusb-1.0-0

# Fixtures of a file are made once, and its tests run in one worker.
BY_FILE := --dist loadfile --no-loadscope-reorder
COMPUTING := not (alone or realtime or slow)
REALTIME := realtime and not slow

# Nodes wait for each other in both; beside other tests, on a slow computer, one may time out.
define judge_again
{ echo 'make test: what failed with other tests beside it is judged again, alone'; \
	$(BIN)/python -m pytest --last-failed --last-failed-no-failures none -m '$(1)'; }
endef

.DEFAULT_GOAL := help
.PHONY: help env lint test test-slow demo bench faults soak docs docs-check reference figures pictures clean distclean

help:
	@echo 'make env     build $(VENV) with all that tests and demo need (PYTHON=$(PYTHON))'
	@echo 'make test    linters, types, documentation and tests; make test-slow: the longest ones'
	@echo 'make demo    scan the demo part in a simulated cell into build/demo'
	@echo 'make bench   measure figures into build/bench; NAME=stripe: one group'
	@echo 'make faults  cause faults in scans and in a cell of real processes, kill scans and'
	@echo '             resume them; more than three hours'
	@echo 'make soak    200 short scans in a row: memory, files and threads that a scan leaves'
	@echo 'make docs    build the documentation into build/docs'
	@echo 'make reference, make figures, make pictures'
	@echo '             write the pages and pictures of docs/ made from code, build/bench, simulation'
	@echo 'make clean   remove build results and caches; make distclean: $(VENV) as well'

env: $(READY)

$(READY): setup.py
	@$(check_python)
	@$(install_libraries)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[ros,docs,test]'
	@$(BIN)/python -c 'import cv2, open3d' || { \
		echo 'make env: OpenCV or Open3D is installed but does not load (see above)' >&2; \
		exit 1; }
	@touch $@

test: $(READY)
	$(MAKE) --no-print-directory -j 2 lint docs-check
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m '$(COMPUTING)' -n 3 $(BY_FILE) || \
		$(call judge_again,$(COMPUTING))
	$(BIN)/python -m pytest -m '$(REALTIME)' -n 2 $(BY_FILE) || $(call judge_again,$(REALTIME))
	$(BIN)/python -m pytest -m 'alone and not slow'

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Long variants of tests, and the stories of README that live in real time.
test-slow: $(READY)
	$(BIN)/python -m pytest -m slow

demo: $(READY)
	$(BIN)/ivfmc demo -o build/demo

bench: $(READY)
	PYTHONPATH=test $(BIN)/python -m bench $(NAME)

faults: $(READY)
	PYTHONPATH=test $(BIN)/python -m bench faults resume

soak: $(READY)
	PYTHONPATH=test $(BIN)/python -m bench soak

# All pages and references are read and checked; writing HTML takes as long again.
docs-check: $(READY)
	$(BIN)/python docs/generate.py reference --check
	$(BIN)/sphinx-build -b dummy -W --keep-going -q docs build/docs-check

docs: $(READY)
	$(BIN)/python docs/generate.py reference --check
	$(BIN)/sphinx-build -W --keep-going -q docs build/docs

reference: $(READY)
	$(BIN)/python docs/generate.py reference

figures: $(READY)
	$(BIN)/python docs/generate.py figures

pictures: $(READY)
	$(BIN)/python docs/pictures.py

clean:
	rm -rf build install log dist *.egg-info .mypy_cache .pytest_cache .ruff_cache
	find ivfmc_ros test -type d -name __pycache__ -prune -exec rm -rf {} +

distclean: clean
	rm -rf $(VENV)

define check_python
$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	echo 'make env: $(PYTHON) is missing or older than 3.11; name another: make env PYTHON=...' >&2; \
	exit 1; }; \
$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	echo 'make env: $(PYTHON) cannot make a venv; on Debian: apt-get install python3-venv' >&2; \
	exit 1; }
endef

# sbin: ldconfig is not on the path of a plain user
define install_libraries
present=$$(PATH="$$PATH:/sbin:/usr/sbin" ldconfig -p); missing=; \
for pair in $(LIBRARIES); do \
	echo "$$present" | grep -qF "$${pair%%:*} " || missing="$$missing $${pair##*:}"; \
done; \
[ -n "$$missing" ] || exit 0; \
request="apt-get install -y --no-install-recommends$$missing"; \
if [ "$$(id -u)" = 0 ]; then as=env; else as='sudo -n'; fi; \
command -v apt-get >/dev/null && $$as true 2>/dev/null \
	&& $$as apt-get update -q && $$as $$request || { \
	echo "make env: Open3D needs libraries of the system; as root: $$request" >&2; \
	exit 1; }
endef
