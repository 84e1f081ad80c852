# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Builds ivfmc_ros, both with pip and with colcon (ament_python)."""

from pathlib import Path

from setuptools import find_packages
from setuptools import setup
from setuptools.command.install_scripts import install_scripts

PACKAGE = 'ivfmc_ros'
COMMAND = 'ivfmc'


class InstallScripts(install_scripts):
    """
    Puts the command on the PATH of a colcon workspace as well.

    setup.cfg sends every executable to lib/ivfmc_ros, where ``ros2 run`` looks for it; a
    person types ``ivfmc``. A wheel holds no scripts at this point (pip writes them into bin/
    itself), so that there is nothing to link.
    """

    def run(self) -> None:
        """Install the scripts, then link the command into ``<prefix>/bin``."""
        super().run()
        script = Path(self.install_dir) / COMMAND
        if script.parent.name != PACKAGE or not script.exists():
            return
        link = script.parents[2] / 'bin' / COMMAND
        link.parent.mkdir(parents=True, exist_ok=True)
        link.unlink(missing_ok=True)
        link.symlink_to(Path('..') / 'lib' / PACKAGE / COMMAND)
        self.outfiles.append(str(link))


def executables() -> list[str]:
    """
    Scripts that start one node each.

    They go to lib/ivfmc_ros, where ``ros2 run`` looks, and not onto the PATH, where names such as
    ``camera`` and ``recorder`` would hide other people's programs.
    """
    return sorted(str(path) for path in Path('resource/executables').iterdir() if path.is_file())


def shared_files() -> list[tuple[str, list[str]]]:
    """Every file below config/, at the same place below share/ivfmc_ros/."""
    files = sorted(path for path in Path('config').rglob('*') if path.is_file())
    return [(f'share/{PACKAGE}/{path.parent}', [str(path)]) for path in files]


setup(
    name=PACKAGE,
    version='0.1.0',
    description='Camera, line laser and turntable as a measuring 3-D scanner for ROS 2',
    long_description=Path('README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    url='https://ivfmc.example/ivfmc_ros',
    project_urls={
        'Documentation': 'https://ivfmc.example/ivfmc_ros/docs',
        'Source': 'https://ivfmc.example/ivfmc_ros/source',
        'Issues': 'https://ivfmc.example/ivfmc_ros/issues',
        'Changelog': 'https://ivfmc.example/ivfmc_ros/source/CHANGELOG.rst',
    },
    classifiers=[
        'Development Status :: 4 - Beta',
        'Environment :: Console',
        'Intended Audience :: Manufacturing',
        'Intended Audience :: Science/Research',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: Python :: 3',
        'Programming Language :: Python :: 3.11',
        'Programming Language :: Python :: 3.12',
        'Topic :: Scientific/Engineering :: Image Processing',
        'Topic :: Scientific/Engineering :: Visualization',
        'Typing :: Typed',
    ],
    keywords=['ROS', '3-D scanner', 'laser triangulation', 'turntable', 'inspection', 'metrology'],
    license='Apache-2.0',
    license_files=['LICENSE'],
    maintainer='ivfmc_ros maintainers',
    maintainer_email='maintainers@ivfmc.example',
    packages=find_packages(exclude=['test', 'test.*']),
    package_data={PACKAGE: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'lib/{PACKAGE}', executables()),
        *shared_files(),
    ],
    python_requires='>=3.11',
    # Lower bounds are the versions of Ubuntu noble, except for OpenCV (see package.xml).
    install_requires=[
        'alembic>=1.13',
        'click>=8.1',
        'fast-simplification>=0.2',
        'matplotlib>=3.6',
        'mcap>=1.1',
        'numpy>=1.26',
        'open3d>=0.18',
        'opencv-python-headless>=4.8',
        'pyserial>=3.5',
        'pyyaml>=6.0',
        'rich>=13.7',
        'rosbags>=0.10.11',
        'scipy>=1.11',
        'sqlalchemy>=1.4.50',
        'zstandard>=0.20',
    ],
    # What judges style and types is pinned: another version would judge otherwise.
    extras_require={
        # In a ROS workspace these are there already; beside it, wheels of Jazzy stand in.
        'ros': [
            'ros-jazzy-common-interfaces>=5.3',
            'ros-jazzy-rclpy[fastrtps]>=7.1',
        ],
        # catalogue of a plant
        'postgresql': ['psycopg[binary]>=3.1'],
        # ivfmc gateway opcua
        'opcua': ['asyncua>=1.1'],
        # ivfmc up --window, ivfmc view
        'window': ['viser>=1.0,<2'],
        # reconstruction of many bags on a cluster
        'dask': ['distributed>=2024.1'],
        # no wheels for ARM
        '3mf': ['lib3mf>=2.3'],
        # what traces the pictures of `make bench NAME=metal`; needs libLLVM 16 or later
        'bench': ['mitsuba>=3.5'],
        # what builds docs/
        'docs': [
            'furo',
            'myst-parser>=2.0',
            'sphinx>=7.2',
            'sphinx-click>=5.0',
            'sphinx-copybutton',
        ],
        'test': [
            'asyncua>=1.1',
            'build>=1.0',
            'colcon-common-extensions>=0.3',
            'distributed>=2024.1',
            'hypothesis>=6.100',
            'jsonschema>=4.18',
            'lib3mf>=2.3; platform_machine == "x86_64"',
            'lxml',
            'mcap-ros2-support>=0.5',
            'mypy==2.4.1',
            'networkx',
            'playwright>=1.40',
            'numpy<2.5',
            'psycopg[binary]>=3.1',
            'psutil>=5.9',
            'pytest>=8.0',
            'pytest-xdist>=3.6',
            'ruff==0.17.6',
            'setuptools>=70.1',
            'trimesh>=4.0',
            'twine>=5.0',
            'types-PyYAML',
            'types-pyserial',
            'viser>=1.0,<2',
        ],
    },
    entry_points={
        'console_scripts': [
            'ivfmc = ivfmc_ros.cli.main:main',
        ],
    },
    cmdclass={'install_scripts': InstallScripts},
    zip_safe=False,
)
